"""Rays against triangles and boxes in float64 and in whole numbers, one by one or all against all."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
from numpy.typing import ArrayLike, NDArray

Float64 = NDArray[np.float64]

MISS = -1


def moeller_trumbore(
    corners: ArrayLike, origins: ArrayLike, directions: ArrayLike
) -> tuple[Float64, Float64, Float64, Float64]:
    """Return t, u, v and the least barycentric coordinate of lines against triangles, arrays that broadcast.

    Möller and Trumbore 1997, "Fast, Minimum Storage Ray/Triangle Intersection": corners (..., 3, 3), the rest (..., 3).
    """
    corners, origins, directions = (np.asarray(array, np.float64) for array in (corners, origins, directions))
    a = corners[..., 0, :]
    e1, e2, away = corners[..., 1, :] - a, corners[..., 2, :] - a, origins - a
    p, q = np.cross(directions, e2), np.cross(away, e1)
    with np.errstate(all="ignore"):
        inverse = 1.0 / (p * e1).sum(axis=-1)
        u, v = (p * away).sum(axis=-1) * inverse, (q * directions).sum(axis=-1) * inverse
        t = (q * e2).sum(axis=-1) * inverse
        return t, u, v, np.minimum(np.minimum(u, v), 1.0 - u - v)


def nearest(
    corners: ArrayLike,
    origins: ArrayLike,
    directions: ArrayLike,
    t_min: float = 0.0,
    t_max: float = np.inf,
    doubt: float = 1e-5,
) -> tuple[NDArray[np.int64], Float64, NDArray[np.bool_]]:
    """Return the triangle that each ray hits first (MISS for none), its t, and whether that is beyond doubt.

    Every ray (R, 3) is tried against every triangle (T, 3, 3). A ray is in doubt if it passes within `doubt` of an
    edge, in barycentric coordinates, of a triangle that it meets in front of the first hit or nearly there.
    """
    corners, origins = np.asarray(corners, np.float64), np.asarray(origins, np.float64)
    directions = np.asarray(directions, np.float64)
    which = np.full(len(origins), MISS)
    distance = np.full(len(origins), np.inf)
    sure = np.ones(len(origins), bool)
    step = max(1, 2_000_000 // max(len(corners), 1))
    for first in range(0, len(origins) if len(corners) else 0, step):
        some = slice(first, first + step)
        t, _, _, inside = moeller_trumbore(corners, origins[some, None], directions[some, None])
        ahead = (t > t_min) & (t < t_max)
        with np.errstate(invalid="ignore"):
            reached = np.where((inside >= 0) & ahead, t, np.inf)
            distance[some] = reached.min(axis=1)
            which[some] = np.where(np.isfinite(distance[some]), reached.argmin(axis=1), MISS)
            near_edge = (np.abs(inside) < doubt) & ahead & (t <= distance[some, None] * (1 + 1e-4))
            also = (
                (inside >= -doubt) & ahead & (np.abs(t - distance[some, None]) <= 1e-5 * distance[some, None])
            )
        sure[some] = ~near_edge.any(axis=1) & (also.sum(axis=1) <= 1)
    return which, distance, sure


def sign_of_difference(a: float, b: float, c: float, d: float) -> int:
    """Return the sign of a b - c d, in fractions."""
    difference = Fraction(float(a)) * Fraction(float(b)) - Fraction(float(c)) * Fraction(float(d))
    return (difference > 0) - (difference < 0)


def box_interval(
    low: ArrayLike, high: ArrayLike, origins: ArrayLike, directions: ArrayLike
) -> tuple[Float64, Float64]:
    """Return where lines enter and leave boxes (..., 3), planes included; a line misses if the first is larger."""
    low, high, origins, directions = (np.asarray(a, np.float64) for a in (low, high, origins, directions))
    with np.errstate(all="ignore"):
        one, other = (low - origins) / directions, (high - origins) / directions
    still = directions == 0
    inside = (origins >= low) & (origins <= high)
    enter = np.where(still, np.where(inside, -np.inf, np.inf), np.minimum(one, other))
    leave = np.where(still, np.where(inside, np.inf, -np.inf), np.maximum(one, other))
    return enter.max(axis=-1), leave.min(axis=-1)


def camera_ray(
    uv: ArrayLike, view_from_clip: ArrayLike, world_from_view: ArrayLike, orthographic: bool
) -> tuple[Float64, Float64]:
    """Return origins and directions (R, 3) of places (R, 2) in the picture, by two points on the line through each.

    Those at depths 1 and 1/2 of the picture, in world space, where the perspective eye is subtracted from neither.
    """
    uv = np.asarray(uv, np.float64)
    world_from_clip = np.asarray(world_from_view, np.float64) @ np.asarray(view_from_clip, np.float64)
    points = []
    for depth in (1.0, 0.5):
        clip = np.column_stack([2 * uv - 1, np.full(len(uv), depth), np.ones(len(uv))])
        world = clip @ world_from_clip.T
        points.append(world[:, :3] / world[:, 3:])
    along = points[1] - points[0]
    origin = points[0] if orthographic else np.broadcast_to(np.asarray(world_from_view)[:3, 3], along.shape)
    return origin, along / np.linalg.norm(along, axis=1, keepdims=True)
