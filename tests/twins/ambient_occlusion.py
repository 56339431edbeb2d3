"""Ambient occlusion in screen space in float64: samples, the estimate from depth, and the blur, from their definitions.

Depth is reversed: 0 infinitely far. `clip_from_view` is that of the picture, row 0 on top.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

Float64 = NDArray[np.float64]

BINOMIAL = np.array([3, 6, 10, 15, 20, 25, 20, 15, 10, 6, 3]) / 133
"""The blur's kernel as the ledger states it."""


def bayer(size: int) -> NDArray[np.int64]:
    """Return the Bayer matrix (size, size) of a power of two, by its recursion."""
    if size == 1:
        return np.zeros((1, 1), np.int64)
    half = 4 * bayer(size // 2)
    return np.block([[half, half + 2], [half + 3, half + 1]])


def rotation_vectors() -> Float64:
    """Return (16, 3) points of the unit sphere in equal steps of z, turned by the golden angle from one to the next."""
    index = np.arange(16)
    z = 1 - (2 * index + 1) / 16
    turn = np.pi * (3 - np.sqrt(5)) * index
    return np.stack([np.sqrt(1 - z**2) * np.cos(turn), np.sqrt(1 - z**2) * np.sin(turn), z], axis=1)


def offsets(about: Float64) -> Float64:
    """Return (8, 3) the corners of a cube of edge 1, reflected about the plane with this unit normal."""
    corners = np.array([[i & 1, i >> 1 & 1, i >> 2] for i in range(8)]) - 0.5
    mirror: Float64 = np.eye(3) - 2 * np.outer(about, about)
    return np.asarray(corners @ mirror.T, np.float64)


def visibility(nearer: ArrayLike) -> Float64:
    """Return 0.45 to 1: 1 / (1 + occlusion^2) of samples (8) `nearer` by so many radii, summed and mapped."""
    dist = np.maximum(np.asarray(nearer, np.float64), 0)
    occlusion = 15 * np.maximum(dist * (2 - dist), 0)
    return np.clip((1 / (1 + occlusion**2)).sum(axis=-1) ** 2 / 64 + 0.45, 0, 1)


def distances(depth: Float64, clip_from_view: Float64) -> Float64:
    """Return metres ahead of the eye; infinite for the sky."""
    inverse = np.linalg.inv(clip_from_view)
    z, w = (inverse[row, 2] * depth + inverse[row, 3] for row in (2, 3))
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(depth > 0, -z / w, np.inf)


def from_depth(depth: ArrayLike, clip_from_view: Float64, radius: float) -> Float64:
    """Return (H, W) the part of the light from everywhere that is visible, from depth alone."""
    depth = np.asarray(depth, np.float64)
    height, width = depth.shape
    own, inverse = distances(depth, clip_from_view), np.linalg.inv(clip_from_view)
    number = bayer(4)
    vectors = rotation_vectors()
    found = np.ones(depth.shape)
    for y, x in np.argwhere(depth > 0):
        ndc = 2 * (np.array([x, y]) + 0.5) / (width, height) - 1
        place = inverse @ (*ndc, depth[y, x], 1.0)
        # Row y of the recursion's matrix runs down, as the picture does; the shader counts the same places.
        around = place[:3] / place[3] + radius * offsets(vectors[number[y % 4, x % 4]]) * (1, 1, 0)
        clip = np.concatenate([around, np.ones((8, 1))], axis=1) @ clip_from_view.T
        seen = (clip[:, :2] / clip[:, 3:] + 1) / 2 * (width, height)
        column, row = np.clip(np.floor(seen), 0, np.array([width, height]) - 1).astype(int).T
        found[y, x] = visibility((own[y, x] - own[row, column]) / radius)
    return found


def blurred(
    values: Float64, depth: ArrayLike, clip_from_view: Float64, tolerance: float, axis: int
) -> Float64:
    """Return values (H, W) blurred along an axis within surfaces.

    A tap of a pixel counts in full if its distance is within `tolerance` metres of the plane through the pixel and its
    neighbour on the side that is nearer in depth, and not from twice as much on.
    """
    depth = np.moveaxis(np.asarray(depth, np.float64), axis, -1)
    values, found = np.moveaxis(values, axis, -1), np.moveaxis(values, axis, -1).copy()
    length = depth.shape[-1]
    for place in np.ndindex(depth.shape):
        row, at = place[:-1], place[-1]
        line = depth[row]
        if line[at] == 0:
            continue
        sides = [s for s in (-1, 1) if 0 <= at + s < length and line[at + s] > 0]
        slope = min((s * (line[at + s] - line[at]) for s in sides), key=abs, default=0.0)
        if len(sides) == 2 and abs(line[at] - line[at - 1]) == abs(line[at + 1] - line[at]):
            slope = line[at + 1] - line[at]
        taps = np.arange(max(at - 5, 0), min(at + 6, length))
        expected = line[at] + slope * (taps - at)
        known = (line[taps] > 0) & (expected > 0)
        taps, expected = taps[known], expected[known]
        apart = np.abs(distances(line[taps], clip_from_view) - distances(expected, clip_from_view))
        weights = BINOMIAL[taps - at + 5] * np.clip(2 - apart / tolerance, 0, 1)
        found[place] = (weights * values[(*row, taps)]).sum() / weights.sum()
    return np.moveaxis(found, -1, axis)
