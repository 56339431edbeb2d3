"""A surface at a place of the picture in float64, and how far rasterisers that round differently may be apart there."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

U = 2.0**-24
"""The relative error of one rounding to single precision."""


def surface_at(
    clip_from_world: ArrayLike, triangles: ArrayLike, size: tuple[int, int], place: tuple[float, float]
) -> tuple[float, float] | None:
    """Return the depth of the nearest front face of `triangles` (T, 3, 3) at a place in pixels, and a bound.

    The bound is on the difference of the depths of two rasterisers, of which one computes the viewport transform
    a s + t in one rounding, and the other in two. None where there is no triangle, or where an edge of the nearest one
    is within 1/128 pixel: rasterisers snap vertices to 1/256 pixel, and then one rounding decides to where.

    Both transforms differ by d = U (|a s| + 2 |a s + t|). In exact arithmetic, a point of the moved triangle has the
    depth of a point of the other one at most d away, which is |gradient| d off. The gradient is a quotient of sums of
    two products: it has 7 U of the sum of their absolute values, and 3 U of itself times the condition of the area. The
    plane is evaluated from a corner of the picture to its other end, which adds 4 U of each term. Both have that error.
    """
    matrix, extent = np.asarray(clip_from_world, float), np.array(size, float)
    clip = np.asarray(triangles, float) @ matrix[:, :3].T + matrix[:, 3]
    clip = clip[(clip[..., 3] > 0).all(axis=-1)]
    ndc = clip[..., :3] / clip[..., 3:]
    screen = (ndc[..., :2] * 0.5 + 0.5) * extent
    edges = np.roll(screen, -1, axis=1) - screen
    away = np.array(place) - screen
    sides = edges[..., 0] * away[..., 1] - edges[..., 1] * away[..., 0]
    with np.errstate(divide="ignore", invalid="ignore"):  # triangles without area
        distance = -sides / np.linalg.norm(edges, axis=-1)  # y is down, so front faces have a negative area
        e, f = edges[:, 0].T, -edges[:, 2].T
        de, df = ndc[:, 1, 2] - ndc[:, 0, 2], ndc[:, 2, 2] - ndc[:, 0, 2]
        area = e[0] * f[1] - e[1] * f[0]
        gradient = np.stack([de * f[1] - df * e[1], df * e[0] - de * f[0]]) / area
        depth = ndc[:, 0, 2] + (gradient.T * away[:, 0]).sum(axis=-1)
    near = np.flatnonzero((distance > -1 / 128).all(axis=-1) & (area < 0))
    if not len(near):
        return None
    one = near[np.argmax(depth[near])]
    if distance[one].min() < 1 / 128:
        return None
    products = np.stack([abs(de * f[1]) + abs(df * e[1]), abs(df * e[0]) + abs(de * f[0])])[:, one]
    condition = (abs(e[0] * f[1]) + abs(e[1] * f[0]))[one] / abs(area[one])
    slope, corner = abs(gradient[:, one]), abs(screen[one]).max(axis=0)
    moved = U * (abs(screen[one] - extent / 2).max(axis=0) + 2 * corner)
    across = 2 * np.maximum(corner, extent)
    rounded = U * ((7 * products / abs(area[one]) + (3 * condition + 4) * slope) @ across + 4 * depth[one])
    return float(depth[one]), float(slope @ moved + 2 * rounded)
