"""Study: an index that differs between neighbours. Each pixel, or each triangle, draws its texture by lot."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from common.images.palette import id_color
from common.lessons import Study
from common.scene import Sampler
from common.settings import knob

STUDY = Study(
    title="random textures",
    idea="Neighbouring pixels may need different descriptors: without `nonuniformEXT` a pixel gets its neighbour's.",
    order=2,
    features=("bindless/nonuniform-indexing",),
)


@dataclass(frozen=True)
class Settings:
    """The knobs of this study."""

    per: str = knob("triangle", "what draws a lot", choices=("pixel", "triangle"))
    nonuniform: bool = knob(
        True, "mark the index as one that differs within a draw; OpenGL here needs no mark"
    )


TEXTURES, VOLUMES = 24, 8
"""Flat textures have the numbers 0 to 23, volumes go on up to 31."""

SIDE = 8
"""Texels of a texture in each direction, volumes in all three."""

CELL = 16
"""Pixels of a cell of the grid, which two triangles fill. Its corners lie where no edge meets a pixel's centre."""

UNIFORM_BYTES = 16
SHADERS = ("studies/random_textures/grid.vert", "studies/random_textures/grid.frag")
SHARP = Sampler("nearest", "nearest", None, "clamp", "clamp")


def defines(settings: Settings) -> tuple[tuple[str, int], ...]:
    """Return what the shaders are told."""
    return (
        ("TEXTURES", TEXTURES),
        ("VOLUMES", VOLUMES),
        ("SIDE", SIDE),
        ("CELL", CELL),
        ("PER_TRIANGLE", int(settings.per == "triangle")),
        ("NONUNIFORM", int(settings.nonuniform)),
    )


def grid(size: tuple[int, int]) -> tuple[int, int]:
    """Return how many cells across and down cover a picture of (width, height)."""
    return size[0] // CELL + 2, size[1] // CELL + 2


def textures() -> np.ndarray:
    """Return (24, 8, 8, 4) uint8: each in a colour of its own, with a pattern that turns from one to the next."""
    row, column = np.mgrid[:SIDE, :SIDE]
    patterns = [(row // 2 + column // 2) % 2, (row + column) // 2 % 2, row // 2 % 2, column // 2 % 2]
    shade = np.stack([0.55 + 0.45 * patterns[number % 4] for number in range(TEXTURES)])
    return _codes(id_color(np.arange(TEXTURES))[:, None, None] * shade[..., None])


def volumes() -> np.ndarray:
    """Return (8, 8, 8, 8, 4) uint8, volume, slice, row, column: grey balls, each in a box of its own tint."""
    across = (np.arange(SIDE) + 0.5) / SIDE * 2.0 - 1.0
    z, y, x = np.meshgrid(across, across, across, indexing="ij")
    inside = (np.sqrt(x * x + y * y + z * z) < 0.9)[None, ..., None]
    tint = 0.25 * id_color(TEXTURES + np.arange(VOLUMES))[:, None, None, None]
    grey = (0.6 + 0.4 * (z + 1.0) / 2.0)[None, ..., None]
    return _codes(np.where(inside, np.broadcast_to(grey, (VOLUMES, *grey.shape[1:])), tint))


def _codes(colors: np.ndarray) -> np.ndarray:
    alpha = np.ones((*colors.shape[:-1], 1))
    return np.rint(255.0 * np.concatenate([colors, alpha], axis=-1)).astype(np.uint8)
