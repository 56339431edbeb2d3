"""Sharpening, FXAA, dither and motion blur in float64 or in whole numbers, from their definitions."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

Float64 = NDArray[np.float64]

REC_709 = np.array([0.2126, 0.7152, 0.0722])
ALIKE = 1e-5
"""Differences of luma that count as none."""

SIDES = ((-1, 0), (1, 0), (0, -1), (0, 1))
"""Rows and columns to the neighbours of a pixel."""


def moved(image: Float64, rows: int, columns: int) -> Float64:
    """Return for each pixel of (H, W, ...) the one so many rows and columns away; beyond the rim is the rim."""
    height, width = image.shape[:2]
    y = np.clip(np.arange(height) + rows, 0, height - 1)
    x = np.clip(np.arange(width) + columns, 0, width - 1)
    return np.asarray(image[y][:, x])


def mean_of_nine(image: Float64) -> Float64:
    """Return the mean of the 3x3 pixels around each pixel."""
    return np.asarray(sum(moved(image, y, x) for y in (-1, 0, 1) for x in (-1, 0, 1)) / 9.0)


def sharpened(image: ArrayLike, amount: float) -> Float64:
    """Return linear light (H, W, 3) with L' = L + (L - mean) amount, L' at least L / (1 + amount), in its old hue."""
    image = np.asarray(image, np.float64)
    light = image @ REC_709
    wanted = light + (light - mean_of_nine(light)) * amount
    wanted = np.maximum(wanted, light / (1.0 + amount))
    factor = np.divide(wanted, light, out=np.ones_like(light), where=light > 0)
    return np.asarray(image * factor[..., None])


def fxaa(image: ArrayLike, share: float, least: float, strength: float, steps: int) -> Float64:
    """Return codes (H, W, 3) of 0 to 1 whose edges are shifted to what straight edges would cover.

    Pixels below the contrast `least`, or below the `share` of the brightest luma beside them, stay. The others become a
    mix with the neighbour across the edge. The part is that of a straight edge between the ends of this one, at most
    `steps` pixels away, or of how much the pixel differs from all around it, times `strength`.
    """
    image = np.asarray(image, np.float64)
    luma = image @ REC_709
    at = {(y, x): moved(luma, y, x) for y in (-1, 0, 1) for x in (-1, 0, 1)}
    cross = np.stack([luma, *(at[side] for side in SIDES)])
    contrast = cross.max(0) - cross.min(0)
    is_edge = contrast >= np.maximum(least, share * cross.max(0))

    tent = sum(at[y, x] * (2 - abs(y)) * (2 - abs(x)) for y, x in at) - 4 * luma
    part = np.clip(np.abs(tent / 12 - luma) / np.where(is_edge, contrast, 1.0), 0, 1)
    detail = strength * (3 * part**2 - 2 * part**3) ** 2

    def bend(axis: int) -> Float64:
        total = np.zeros_like(luma)
        for along, weight in ((-1, 1), (0, 2), (1, 1)):
            three = [at[(across, along) if axis == 0 else (along, across)] for across in (-1, 0, 1)]
            total += weight * np.abs(three[0] - 2 * three[1] + three[2])
        return total

    bends = np.stack([bend(0), bend(1)])
    step = np.abs(np.stack([at[side] - luma for side in SIDES]))
    total, count = np.zeros_like(image), np.zeros_like(luma)
    for number, side in enumerate(SIDES):
        other = SIDES[number ^ 1]
        axis = number // 2
        chosen = is_edge & (bends[axis] >= bends.max(0) - ALIKE)
        chosen &= step[number] >= step[SIDES.index(other)] - ALIKE
        mean = (luma + at[side]) / 2
        reached = np.full((2, *luma.shape), steps + 1)
        bent = np.zeros((2, *luma.shape), bool)
        for way, sign in enumerate((1, -1)):
            for i in range(steps, 0, -1):
                y, x = (0, sign * i) if axis == 0 else (sign * i, 0)
                away = (moved(luma, y, x) + moved(luma, y + side[0], x + side[1])) / 2 - mean
                ends = np.abs(away) >= step[number] / 4 - ALIKE
                reached[way][ends] = i
                bent[way] = np.where(ends, (away < 0) != (luma < mean), bent[way])
        nearest, span = reached.min(0), reached.sum(0) - 1
        nearer = np.where(reached[0] < reached[1], bent[0], bent[1])
        shift = np.where(nearer, np.maximum(0.5 - (nearest - 0.5) / span, 0), 0)
        mix = np.maximum(shift, detail)[..., None]
        total += chosen[..., None] * (image + (moved(image, *side) - image) * mix)
        count += chosen
    return np.asarray(np.where(count[..., None] > 0, total / np.maximum(count, 1)[..., None], image))


def covered(height: int, width: int, normal: tuple[float, float], offset: float) -> Float64:
    """Return the area (H, W) of each pixel with x nx + y ny below `offset`, integrated along rows; nx is not 0."""
    nx, ny = normal
    y, x = np.indices((height, width)).astype(np.float64)
    parts = (np.arange(512) + 0.5) / 512
    ends = (offset - ny * (y[..., None] + parts)) / nx - x[..., None]
    lengths = np.clip(ends, 0, 1) if nx > 0 else 1 - np.clip(ends, 0, 1)
    return np.asarray(lengths.mean(-1))


def interleaved_gradient(x: ArrayLike, y: ArrayLike, frame: int) -> Float64:
    """Return Jimenez's noise of pixels in a frame, from fractions over 2^32 in Python's whole numbers."""
    whole = 2**32
    inner = np.asarray(x, object) * 288237660 + np.asarray(y, object) * 25070368 + frame % 64 * 1750839832
    inner = inner % whole
    outer = (52 * inner + inner * 4221604530 // whole) % whole
    return np.asarray(((outer // 512 + 0.5) / 2**23), np.float64)


def triangle_of(even: ArrayLike) -> Float64:
    """Return the number at which the triangular distribution over (-1, 1) has reached `even`."""
    even = np.asarray(even, np.float64)
    return np.where(even < 0.5, np.sqrt(2 * even) - 1, 1 - np.sqrt(2 - 2 * even))


def with_noise(code: ArrayLike, even: ArrayLike, steps: float) -> Float64:
    """Return codes (..., 3) in 8-bit steps with noise of a triangle, of one even step near an end, or of none there."""
    value = 255 * np.asarray(code, np.float64)
    even = np.asarray(even, np.float64)[..., None]
    room = np.minimum(value, 255 - value)
    noise = np.where(room < steps, min(steps, 1) * (even - 0.5), steps * triangle_of(even))
    return np.where(room < 0.001, value, value + noise)
