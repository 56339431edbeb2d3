"""Squares of stripes that only turns can find, over eight frames."""

from __future__ import annotations

from typing import Any

import numpy as np

from common.scene import Image, Light, Material
from tests.support.scenes import facing, quad_scene, texture
from tools.exercises.checking import Given

SIDE = 64
FRAMES = 8
KNOBS: dict[str, Any] = {
    "graph": "compute",
    "gbuffer_format": "full",
    "anisotropy": 1.0,
    "ambient": 0.0,
    "shadows": "off",
    "rate_texel": 16,
    "rate_threshold": 32.0,
    "rate_surface": 1.0,
}


def check(given: Given) -> None:
    """Each square of the mask is fine in one frame of eight, and in no frame are all of them."""
    texel = KNOBS["rate_texel"]
    view, scene = facing(), _stripes()
    whole = given.draw(scene, view, size=(SIDE, SIDE), rate_policy="none", **KNOBS)
    with given.open(scene, (SIDE, SIDE), ("color_linear",), rate_policy="sobel", **KNOBS) as renderer:
        frames = [renderer.render(view).image("color_linear") for _ in range(FRAMES + 1)][1:]
    given.silent()
    count = SIDE // texel
    fine = np.stack(
        [
            (frame == whole).all(axis=-1).reshape(count, texel, count, texel).all(axis=(1, 3))
            for frame in frames
        ]
    )
    never = ~fine.any(axis=0)
    for row, column in np.argwhere(never)[:1].tolist():
        given.need(
            False,
            f"{never.sum()} of {never.size} squares are lit by blocks in each of {FRAMES} frames, the first one in "
            f"column {column} and row {row}.",
        )
    every = fine.all(axis=(1, 2))
    given.need(not every.any(), f"In {every.sum()} of {FRAMES} frames each square is lit in full.")


def _stripes() -> Any:
    """Return a wall with stripes of one pixel: a block of 2x2 has one light, and no edge is left."""
    codes = np.zeros((SIDE, SIDE, 4), np.uint8)
    codes[..., 3], codes[:, ::2, :3] = 255, 255
    material = Material(roughness=1.0, metallic=0.0, base_color_texture=texture(0))
    lamp = Light("directional", 0, intensity=3.0)
    return quad_scene(material, lights=(lamp,), images=(Image("stripes", codes),))
