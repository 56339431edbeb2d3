"""Study: pictures in rectangles of pixels, as a debug view shows textures; depth is shown as distance."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from common.errors import UserError
from common.lessons import Study
from common.settings import knob

from ..drawing import Drawn
from ..textured_mesh import tiles

STUDY = Study(
    title="textured quads",
    idea="A texel is shown unchanged where its centre meets a pixel's centre; depth must be undone before it is shown.",
    order=33,
    features=("debug-draw/textured-quads",),
)


@dataclass(frozen=True)
class Settings:
    """The knobs of this study."""

    far: float = knob(6.0, "distance that is shown white", unit="m", minimum=0.01, maximum=1e6)


@dataclass(frozen=True)
class Quad:
    """A rectangle of pixels, `x` and `y` from the top left, and which of the textures it shows."""

    x: int
    y: int
    width: int
    height: int
    shows: Literal["picture", "depth"]


RECORD = np.dtype([("place", np.float32, 4), ("shows", np.uint32), ("_padding", np.uint32, 3)])
"""A quad as the shader reads it, 32 bytes: x, y, width, height in pixels, and 0 for the picture or 1 for depth."""

CAPACITY = 256
UNIFORM_BYTES = 16
DRAWN = Drawn(("quad.vert", "quad.frag"), depth=False)
NEAR = 0.1
TEXTURE_SIZE = 96


def quads_for(size: tuple[int, int]) -> list[Quad]:
    """Return what is drawn in a picture of (width, height): both textures, texel by pixel and as large as fits."""
    side, gap = TEXTURE_SIZE, max(4, size[0] // 40)
    quads = []
    for number, shows in enumerate(("picture", "depth")):
        x = gap + number * (size[0] // 2)
        quads.append(Quad(x, gap, side, side, shows))  # type: ignore[arg-type]
        large = min(2 * side, size[0] // 2 - 2 * gap, size[1] - side - 3 * gap)
        quads.append(Quad(x, side + 2 * gap, max(large, 1), max(large, 1), shows))  # type: ignore[arg-type]
    return quads


def records_of(quads: Sequence[Quad]) -> np.ndarray:
    """Return (N,) RECORD; raise UserError for more than fit."""
    if len(quads) > CAPACITY:
        raise UserError(
            f"The study textured-quads draws {CAPACITY} quads at most, not {len(quads)}: draw fewer."
        )
    records = np.zeros(len(quads), RECORD)
    for record, quad in zip(records, quads, strict=True):
        record["place"] = quad.x, quad.y, quad.width, quad.height
        record["shows"] = quad.shows == "depth"
    return records


def uniforms(settings: Settings, size: tuple[int, int]) -> np.ndarray:
    """Return what the shaders read, (4,) float32: the picture's size, the near plane and what is shown white."""
    return np.array([*size, NEAR, settings.far], np.float32)


def picture_texels() -> np.ndarray:
    """Return (96, 96, 4) uint8."""
    return tiles(TEXTURE_SIZE)


def depth_texels() -> np.ndarray:
    """Return (96, 96, 1) float32, reversed z: a floor half a metre below the eye, a ball 3 m away, and sky (0)."""
    at = ((np.arange(TEXTURE_SIZE) + 0.5) / TEXTURE_SIZE * 2 - 1) * math.tan(math.radians(25.0))
    x, down = np.meshgrid(at, at)
    with np.errstate(divide="ignore"):
        distance = np.where(down > 0, 0.5 / down, np.inf)
    # Along (x, -down, -1) t, with the ball of radius 0.7 at (0, 0, -3): t^2 |ray|^2 - 6 t + 9 - 0.49 = 0.
    squared = x * x + down * down + 1.0
    root = 9.0 - squared * (9.0 - 0.49)
    ball = np.where(root > 0, (3.0 - np.sqrt(np.maximum(root, 0.0))) / squared, np.inf)
    return (NEAR / np.minimum(distance, ball))[..., None].astype(np.float32)
