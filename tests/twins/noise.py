"""Gradient noise in float64, its hash in whole numbers (Perlin 2002; Jarzynski and Olano 2020)."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

Float64 = NDArray[np.float64]

GRADIENTS = np.array(
    [
        *((1, 1, 0), (-1, 1, 0), (1, -1, 0), (-1, -1, 0)),
        *((1, 0, 1), (-1, 0, 1), (1, 0, -1), (-1, 0, -1)),
        *((0, 1, 1), (0, -1, 1), (0, 1, -1), (0, -1, -1)),
        *((1, 1, 0), (0, -1, 1), (-1, 1, 0), (0, -1, -1)),
    ],
    np.float64,
)
"""Perlin's table: the twelve middles of a cube's edges, and four of them again to make sixteen."""


def pcg3d(words: ArrayLike) -> NDArray[np.uint64]:
    """Return three words of 32 bits (..., 3) from three (..., 3)."""
    low = np.uint64(0xFFFFFFFF)
    v = (np.asarray(words).astype(np.uint64) * np.uint64(1664525) + np.uint64(1013904223)) & low
    for shift in (16, 0):
        for to, a, b in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
            # The product of two words may fill 64 bits; what a sum carries beyond them is cut anyway.
            v[..., to] = (v[..., to] + (v[..., a] * v[..., b] & low)) & low
        v ^= v >> np.uint64(shift) if shift else np.uint64(0)
    return v


def gradients(corners: ArrayLike, period: int, seed: int) -> Float64:
    """Return the gradients (..., 3) at corners (..., 3) of the lattice, which repeat after `period`."""
    words = np.asarray(corners, np.int64) % period
    words[..., 2] = (words[..., 2] + seed * 0x9E3779B9) % 2**32
    return GRADIENTS[(pcg3d(words)[..., 0] >> np.uint64(28)).astype(int)]


def gradient_noise(points: ArrayLike, period: int, seed: int) -> Float64:
    """Return noise (...) at points (..., 3) in units of the lattice."""
    points = np.asarray(points, np.float64)
    corner = np.floor(points).astype(int)
    inside = points - corner
    total = np.zeros(points.shape[:-1])
    for step in np.ndindex(2, 2, 2):
        away = np.abs(inside - step)
        # 1 - fade(t) is fade(1 - t): each corner has the product of three falling fades.
        weight = 1 - away**3 * (away * (away * 6 - 15) + 10)
        product = (gradients(corner + step, period, seed) * (inside - step)).sum(axis=-1)
        total += weight.prod(axis=-1) * product
    return total


def octaves_of_noise(uvw: ArrayLike, frequency: int, octaves: int, seed: int) -> Float64:
    """Return the mean of octaves with weights 1, 1/2, 1/4, ..., mapped to 0..1, clamped."""
    uvw = np.asarray(uvw, np.float64)
    weights = 0.5 ** np.arange(octaves)
    parts = [gradient_noise(uvw * (frequency << k), frequency << k, seed + k) for k in range(octaves)]
    return np.clip(0.5 + 0.5 * np.tensordot(weights, parts, 1) / weights.sum(), 0, 1)


def tiled(volume: Float64, uvw: ArrayLike) -> Float64:
    """Return (...) a volume (Z, Y, X) between texel centres by three linear steps; it repeats after 1 in every axis."""
    volume, uvw = np.asarray(volume, np.float64), np.asarray(uvw, np.float64)
    size = np.array(volume.shape[::-1])
    place = uvw * size - 0.5
    first = np.floor(place).astype(int)
    part = place - first
    total = np.zeros(uvw.shape[:-1])
    for corner in np.ndindex(2, 2, 2):
        x, y, z = np.moveaxis((first + corner) % size, -1, 0)
        total += np.where(corner, part, 1 - part).prod(axis=-1) * volume[z, y, x]
    return total


def in_wind(
    volume: Float64, points: ArrayLike, per_metre: float, velocity: ArrayLike, seconds: float
) -> Float64:
    """Return (...) noise at points (..., 3) of the world; the volume spans 1 / `per_metre` metres and moves with wind.

    What is at a point was upwind before. The shift is wrapped before it meets a position, so it never grows.
    """
    shift = np.asarray(velocity, np.float64) * seconds * per_metre % 1.0
    return tiled(volume, np.asarray(points, np.float64) * per_metre - shift)
