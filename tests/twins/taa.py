"""Temporal anti-aliasing in float64: shifts, filters, histories between texels, neighbourhoods, constraints, weights.

Pictures are (H, W, ...) with row 0 at the top, uv is (N, 2) in [0, 1] right and down, colours are (..., 3).
"""

from __future__ import annotations

from collections.abc import Callable
from fractions import Fraction

import numpy as np
from numpy.typing import ArrayLike, NDArray

Float64 = NDArray[np.float64]

YCOCG = np.array([[1, 2, 1], [2, 0, -2], [-1, 2, -1]]) / 4.0
"""Rows: luma, orange less blue, green less purple (Malvar and Sullivan 2003)."""

BT709 = np.array((0.2126, 0.7152, 0.0722))


# --- shifts -----------------------------------------------------------------------------------------------------------


def digits_mirrored(index: int, base: int) -> Fraction:
    """Return a whole number's digits behind the point, the last one first, as a fraction."""
    value, place = Fraction(0), Fraction(1, base)
    while index:
        index, digit = divmod(index, base)
        value += digit * place
        place /= base
    return value


def lattice_step() -> tuple[float, float]:
    """Return the step of Roberts' sequence in two dimensions: 1 / p and 1 / p^2 of the real root p of x^3 = x + 1."""
    root = float(np.roots((1, 0, -1, -1))[np.isreal(np.roots((1, 0, -1, -1)))].real[0])
    return 1 / root, 1 / root**2


# --- filters ----------------------------------------------------------------------------------------------------------


def cubic(x: ArrayLike, b: float, c: float) -> Float64:
    """Return the cubic filters of Mitchell and Netravali 1988, equation 8."""
    x = np.abs(np.asarray(x, np.float64))
    inside = (12 - 9 * b - 6 * c) * x**3 + (-18 + 12 * b + 6 * c) * x**2 + (6 - 2 * b)
    outside = (-b - 6 * c) * x**3 + (6 * b + 30 * c) * x**2 + (-12 * b - 48 * c) * x + (8 * b + 24 * c)
    return np.where(x < 1, inside, np.where(x < 2, outside, 0.0)) / 6


def harris(x: ArrayLike, radius: float) -> Float64:
    """Return the window of four terms of Harris 1978, centred at 0."""
    x = np.asarray(x, np.float64)
    terms = (0.35875, 0.48829, 0.14128, 0.01168)
    window = sum(a * np.cos(np.pi * k * x / radius) for k, a in enumerate(terms))
    return np.where(np.abs(x) < radius, window, 0.0)


LINES: dict[str, Callable[[Float64], Float64]] = {
    "tent": lambda x: np.maximum(1 - np.abs(x), 0.0),
    "mitchell": lambda x: cubic(x, 1 / 3, 1 / 3),
    "blackman_harris": lambda x: harris(x, 1.5),
    "catmull_rom_weight": lambda x: cubic(x, 0.0, 0.5),
}
"""The filters along an axis, in the order of FILTER from 1 on."""


def weight(name: str, offset: Float64) -> Float64:
    """Return (...) the weights of offsets (..., 2) in pixels."""
    return LINES[name](offset).prod(axis=-1)


# --- histories --------------------------------------------------------------------------------------------------------


def sampled(picture: Float64, uv: Float64, line: Callable[[Float64], Float64], radius: int) -> Float64:
    """Return (N, C): the sum over the texels within `radius` of uv, by a filter whose weights are made to sum to 1."""
    height, width = picture.shape[:2]
    place = uv * (width, height) - 0.5
    first = np.floor(place).astype(int) - radius + 1
    found, total = 0.0, 0.0
    for y in range(2 * radius):
        for x in range(2 * radius):
            texel = first + np.array((x, y))
            by = (line(place[:, 0] - texel[:, 0]) * line(place[:, 1] - texel[:, 1]))[:, None]
            rows, columns = texel[:, 1].clip(0, height - 1), texel[:, 0].clip(0, width - 1)
            found, total = found + by * picture[rows, columns], total + by
    return found / total


def bilinear(picture: Float64, uv: Float64) -> Float64:
    """Return (N, C) a picture between its texels, linear along both axes."""
    return sampled(picture, uv, LINES["tent"], 1)


def catmull_rom(picture: Float64, uv: Float64) -> Float64:
    """Return (N, C) a picture between its texels by cubic curves through them, at least 0."""
    return np.maximum(sampled(picture, uv, LINES["catmull_rom_weight"], 2), 0.0)


# --- neighbourhoods ---------------------------------------------------------------------------------------------------


def nine(picture: Float64, x: int, y: int) -> Float64:
    """Return (9, ...) the 3x3 around a pixel in rows, with the border repeated."""
    height, width = picture.shape[:2]
    return np.array(
        [
            picture[min(max(y + down, 0), height - 1), min(max(x + right, 0), width - 1)]
            for down in (-1, 0, 1)
            for right in (-1, 0, 1)
        ]
    )


def positions(jitter: ArrayLike) -> Float64:
    """Return (9, 2): where the samples of a 3x3 lie, from its middle, in the picture without the shift."""
    return np.array([(right, down) for down in (-1, 0, 1) for right in (-1, 0, 1)]) - np.asarray(
        jitter, float
    )


def filtered(samples: Float64, jitter: Float64, name: str) -> Float64:
    """Return (N, 3): samples (N, 9, 3) that lie at shifted places, filtered at the middle."""
    by = np.array([weight(name, positions(one)) for one in jitter])[..., None]
    return (by * samples).sum(axis=1) / by.sum(axis=1)


# --- constraints ------------------------------------------------------------------------------------------------------


def clipped(history: Float64, low: Float64, high: Float64, middle: Float64 | None = None) -> Float64:
    """Return (N, 3): where the way from the middle of boxes to points leaves the box, or the point if it never does.

    The way is cut by the two planes of each axis in turn. `middle` may be another place in each box.
    """
    middle = (low + high) / 2 if middle is None else middle
    way = history - middle
    share = np.ones(len(history))
    for axis in range(3):
        for plane in (low, high):
            with np.errstate(divide="ignore", invalid="ignore"):
                at = (plane[:, axis] - middle[:, axis]) / way[:, axis]
            towards = np.sign(way[:, axis]) * (plane[:, axis] - middle[:, axis]) >= 0
            share = np.where(towards & (way[:, axis] != 0) & np.isfinite(at), np.minimum(share, at), share)
    return middle + way * share[:, None]


# --- weights of the history -------------------------------------------------------------------------------------------


def young(share: ArrayLike) -> Float64:
    """Return the factor of a history's weight by its age: 1 up to a share of 0.1, and 0 where there is no history."""
    return np.interp(np.asarray(share, np.float64), (0.1, 1.0), (1.0, 0.0))


def by_contrast(current: ArrayLike, low: ArrayLike, high: ArrayLike) -> Float64:
    """Return the history's weight by how much luminances of neighbours differ, against that of the pixel."""
    contrast = (np.asarray(high, np.float64) - low) / np.maximum(current, 1e-4)
    return np.interp(contrast, (0.0, 1.0), (0.25, 0.85))


def by_difference(current: ArrayLike, history: ArrayLike, least: float = 0.88, most: float = 0.97) -> Float64:
    """Return the history's weight by how alike two luminances are (Pedersen 2016)."""
    current, history = np.asarray(current, np.float64), np.asarray(history, np.float64)
    unlike = np.abs(current - history) / np.maximum(np.maximum(current, history), 0.2)
    return least + (most - least) * (1 - unlike) ** 2


# --- vectors ----------------------------------------------------------------------------------------------------------


def closest(depth: Float64) -> NDArray[np.int64]:
    """Return (H, W, 2): x and y of the largest depth in the 3x3 of each pixel, the pixel itself where it is as large.

    Of several that are larger than the pixel's and equal, the first in rows is taken.
    """
    height, width = depth.shape
    found = np.zeros((height, width, 2), np.int64)
    for y in range(height):
        for x in range(width):
            around = nine(depth, x, y)
            places = nine(np.stack(np.meshgrid(np.arange(width), np.arange(height)), -1), x, y)
            found[y, x] = (x, y) if around[4] == around.max() else places[around.argmax()]
    return found


def longest(motion: Float64) -> Float64:
    """Return (H, W, 2): the vector of the 3x3 that is longest in pixels; `motion` is in uv units."""
    height, width = motion.shape[:2]
    found = np.zeros_like(motion)
    for y in range(height):
        for x in range(width):
            around = nine(motion, x, y)
            length = np.hypot(*(around * (width, height)).T)
            found[y, x] = motion[y, x] if length[4] == length.max() else around[length.argmax()]
    return found
