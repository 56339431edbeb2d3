"""Colours for numbers that are no light: heat for how many, a hue drawn by lot for which one.

shaders/palette.glsl is the same for shaders.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

MAGENTA = (1.0, 0.0, 1.0)
"""What stands for NaN and infinity: no scale here has it."""

HEAT = np.array([(0, 0, 0), (0, 0, 1), (0, 1, 1), (0, 1, 0), (1, 1, 0), (1, 0, 0), (1, 1, 1)], np.float64)
"""The colours of a heat scale, evenly spaced from 0 to 1."""


def heat(t: ArrayLike) -> NDArray[np.float64]:
    """Return the colours (..., 3) of numbers `t` (...) between 0 and 1; beyond, those of the ends."""
    steps = np.arange(len(HEAT)) / (len(HEAT) - 1)
    return np.stack(
        [np.interp(np.asarray(t, np.float64), steps, HEAT[:, channel]) for channel in range(3)], axis=-1
    )


def scrambled(values: ArrayLike) -> NDArray[np.uint32]:
    """Return PCG hashes (Jarzynski and Olano 2020, one permutation step) of uint32 `values`, of their shape."""
    mask = np.uint64(0xFFFFFFFF)

    def cut(wide: Any) -> Any:
        return np.asarray(wide, np.uint64) & mask

    state = cut(cut(np.asarray(values)) * np.uint64(747796405) + np.uint64(2891336453))
    word = cut(((state >> ((state >> np.uint64(28)) + np.uint64(4))) ^ state) * np.uint64(277803737))
    return ((word >> np.uint64(22)) ^ word).astype(np.uint32)


def id_color(ids: ArrayLike) -> NDArray[np.float64]:
    """Return a colour (..., 3) for each of `ids` (...) uint32, the same for ever and never black."""
    bits = scrambled(ids).astype(np.int64)
    hue = (bits & 0xFFFF)[..., None] * (6.0 / 65536.0)
    saturation = 0.5 + 0.5 * ((bits >> 16) & 0xFF)[..., None] / 255.0
    brightness = 0.6 + 0.4 * (bits >> 24)[..., None] / 255.0
    pure = np.clip(np.abs(np.mod(hue + np.array([0.0, 4.0, 2.0]), 6.0) - 3.0) - 1.0, 0.0, 1.0)
    return np.asarray(brightness * (1.0 + saturation * (pure - 1.0)), np.float64)


def part_id(objects: ArrayLike, parts: ArrayLike) -> NDArray[np.uint32]:
    """Return one id for a part of an object: equal parts of different objects differ."""
    return np.asarray(parts, np.uint32) ^ scrambled(objects)
