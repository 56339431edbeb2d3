"""Rays against every triangle in float64: what is hit, where, from which side, and how far from an edge."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Float64 = NDArray[np.float64]


@dataclass(frozen=True)
class Hits:
    """The nearest hit of each ray: (N,) arrays, `at` (N, 2). A miss has instance -1 and t infinite.

    `margin` is the least distance, in barycentric coordinates, of any crossed plane from an edge of its triangle, in
    front of the ray's end: where it is tiny, rounding decides about the hit.
    """

    t: Float64
    instance: NDArray[np.int64]
    primitive: NDArray[np.int64]
    at: Float64
    back: NDArray[np.bool_]
    margin: Float64


def nearest(
    origins: Float64,
    directions: Float64,
    t_min: float,
    t_max: float,
    triangles: Float64,
    ids: NDArray[np.int64],
    backs: NDArray[np.bool_] | bool = True,
    fronts: NDArray[np.bool_] | bool = True,
) -> Hits:
    """Return what rays (N, 3) hit of `triangles` (T, 3, 3) in world space.

    `ids` (T, 3) are the instance, the number in its mesh, and whether it is mirrored. `backs` and `fronts` (T,) tell
    which triangles are hit from that side.

    By Möller and Trumbore, "Fast, Minimum Storage Ray/Triangle Intersection" (1997). A triangle is seen from its back
    where its corners run clockwise in object space, so a mirrored one where they run counter-clockwise in the world.
    """
    origins, directions = np.asarray(origins, np.float64), np.asarray(directions, np.float64)
    first, second = triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        p = np.cross(directions[:, None], second)
        determinant = np.einsum("ijk,jk->ij", p, first)
        from_corner = origins[:, None] - triangles[:, 0]
        u = np.einsum("ijk,ijk->ij", from_corner, p) / determinant
        q = np.cross(from_corner, first)
        v = np.einsum("ik,ijk->ij", directions, q) / determinant
        t = np.einsum("ijk,jk->ij", q, second) / determinant
        inside = np.minimum(np.minimum(u, v), 1.0 - u - v)
        ahead = (t > t_min) & (t < t_max)
        ahead &= np.where((determinant < 0.0) != (ids[:, 2] != 0), backs, fronts)
        reached = np.where((inside >= 0.0) & ahead, t, np.inf)
    near = reached.argmin(axis=1) if len(triangles) else np.zeros(len(origins), np.int64)
    rows = np.arange(len(origins))
    if not len(triangles):
        infinite = np.full(len(origins), np.inf)
        nothing = np.full(len(origins), -1)
        return Hits(infinite, nothing, nothing, np.zeros((len(origins), 2)), nothing > 0, infinite)
    distance = reached[rows, near]
    hit = np.isfinite(distance)
    with np.errstate(invalid="ignore"):
        close = np.where(ahead & np.isfinite(inside), np.abs(inside), np.inf).min(axis=1)
    back = (determinant[rows, near] < 0.0) != (ids[near, 2] != 0)
    return Hits(
        distance,
        np.where(hit, ids[near, 0], -1),
        np.where(hit, ids[near, 1], -1),
        np.where(hit[:, None], np.stack([u[rows, near], v[rows, near]], axis=1), 0.0),
        hit & back,
        close,
    )
