"""Squares of all materials under lamps and light from everywhere: what occlusion may dim, and by how much."""

from __future__ import annotations

from typing import Any

import numpy as np

import chapters
from common.scene import Scene
from tests.support.jumble import CAMERA, jumble
from tests.support.occluded import RESULT, STEP, codes
from tools.exercises.checking import Given

SIZE = (48, 32)
KNOBS: dict[str, Any] = {
    "graph": "deferred",
    "gbuffer_format": "full",
    "color_format": "rgba32f",
    "anisotropy": 1.0,
    "ssao_radius": 0.15,
    "tone_curve": "none",
}


def check(given: Given) -> None:
    """With occlusion, without it, and without light from everywhere; by both estimates."""
    scene = jumble(3, tuple(kind for kind in jumble(3).materials if kind.alpha_mode != "blend"))
    (plain, _), (dark, _) = (_frame(given, scene, ambient=ambient) for ambient in (0.5, 0.0))
    least = 2e-5 * float(plain.max())
    for method, scale, bias in (("depth", 0.8, 0.1), ("normals", 1.0, 0.0)):
        dimmed, visible = _frame(given, scene, ambient=0.5, ssao=method, ssao_scale=scale, ssao_bias=0.1)
        assert visible is not None
        factor = 1 - scale * (1 - np.clip(visible + bias, 0, 1))[..., None]
        wanted = dark + factor * (plain - dark)
        same = np.isclose(plain, dark, rtol=0, atol=least).all(axis=-1) & (plain.max(axis=-1) > least)
        for where, sentence in (
            (
                same & (np.abs(dimmed - plain) > least).any(axis=-1),
                "no light from everywhere counts, and its colour changes from {plain} to {dimmed}",
            ),
            (
                (dimmed < dark - least).any(axis=-1),
                "lamps and emission alone give {dark}, and with occlusion {dimmed} is left of all light",
            ),
            (
                (dimmed > plain + least).any(axis=-1),
                "the light without occlusion is {plain}, and with it {dimmed}",
            ),
            (
                (np.abs(dimmed - wanted) > least).any(axis=-1),
                "a factor of {factor} on {ambient} of light from everywhere should give {wanted} in all, and {dimmed} "
                "is seen",
            ),
        ):
            for y, x in np.argwhere(where)[:1].tolist():
                values = {
                    "plain": plain,
                    "dark": dark,
                    "dimmed": dimmed,
                    "ambient": plain - dark,
                    "wanted": wanted,
                }
                shown = {name: f"{image[y, x].mean():.3f}" for name, image in values.items()}
                shown["factor"] = f"{factor[y, x, 0]:.2f}"
                given.need(False, f"With ssao={method}, at pixel ({x}, {y}) {sentence.format(**shown)}.")


def _frame(given: Given, scene: Scene, **knobs: Any) -> tuple[np.ndarray, np.ndarray | None]:
    """Return the picture (H, W, 3) in linear light, and the visible part of each pixel, None without occlusion."""
    module = chapters.renderer_module(given.which, given.backend)
    settings = given.settings(**KNOBS, **knobs)
    with module.Renderer(
        scene, SIZE, settings, outputs={"color_linear"}, device=given.device, inspect=True
    ) as renderer:
        frame = renderer.render(CAMERA)
        picture = frame.image("color_linear")[..., :3].astype(np.float64)
        visible = codes(frame, RESULT) * STEP if "ssao" in knobs else None
    given.silent()
    return picture, visible
