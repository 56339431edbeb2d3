"""What a mesh costs and how far two surfaces are apart: vertex cache misses, and a sampled Hausdorff distance.

ACMR and ATVR say how often the vertex shader runs, by simulating the cache of transformed vertices that once was a
queue in every GPU. Today's GPUs work differently, but what is good for the queue is still good for them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from common.scene import Float32, Float64, UInt32

CACHE_SIZE = 16
"""Vertices in the queue; sizes from 12 to 32 were common."""
_GROUP = 16
"""Triangles that share a box when the nearest one is looked for."""
_PIECES = 50_000
_PAIRS = 2**18
"""Pairs of a point and a box, or of a point and a triangle, that are looked at together: bounds the memory."""


@dataclass(frozen=True)
class CacheUse:
    """How a vertex cache gets on with an index buffer."""

    misses: int  # times the vertex shader runs
    acmr: float  # average cache miss ratio: misses per triangle; 3 without any reuse, about 0.5 for a regular grid
    atvr: float  # average transform to vertex ratio: misses per distinct vertex; 1 is best


def cache_use(indices: UInt32, size: int = CACHE_SIZE) -> CacheUse:
    """Return how a first-in-first-out cache of `size` vertices fares with the triangles of `indices` (3 T,).

    A vertex stays in the queue until `size` others have come in after it; being used again does not prolong that
    (Hoppe 1999, "Optimization of Mesh Locality for Transparent Vertex Caching"). So one number per vertex is the
    whole cache: the count of misses when it came in.
    """
    if len(indices) == 0:
        return CacheUse(0, 0.0, 0.0)
    entered = [-size - 1] * (int(indices.max()) + 1)
    misses = 0
    for (
        vertex
    ) in indices.tolist():  # whether one misses depends on all before it, so there is nothing to vectorise
        if misses - entered[vertex] > size:
            entered[vertex] = misses
            misses += 1
    distinct = len(np.unique(indices))
    return CacheUse(misses, misses / (len(indices) // 3), misses / distinct)


def hausdorff(
    positions_a: Float32 | Float64,
    indices_a: UInt32,
    positions_b: Float32 | Float64,
    indices_b: UInt32,
    samples: int = 2000,
    seed: int = 0,
) -> float:
    """Return the sampled Hausdorff distance of two surfaces, in the units of `positions` (V, 3).

    That is the largest distance from a point on one surface to the other surface, both ways: one way alone would not
    see a part that is missing. `samples` points are spread over each surface by area, and as many of its vertices are
    added, since the farthest point of a convex part is a corner. Distances to triangles are exact (float64), so the
    result is a lower bound of the true distance that grows towards it with `samples`.
    """
    a, b = (
        np.asarray(positions, np.float64)[indices].reshape(-1, 3, 3)
        for positions, indices in ((positions_a, indices_a), (positions_b, indices_b))
    )
    if len(a) == 0 or len(b) == 0:
        return 0.0 if len(a) == len(b) else float("inf")
    rng = np.random.default_rng(seed)
    return max(
        float(distances_to_triangles(sample_points(surface, samples, rng), other).max())
        for surface, other in ((a, b), (b, a))
    )


def surely_within(
    positions_a: Float32 | Float64,
    indices_a: UInt32,
    positions_b: Float32 | Float64,
    indices_b: UInt32,
    bound: float,
) -> bool:
    """Return whether no point of surface a is farther than `bound` from surface b, proven for all points of it.

    A triangle is done with where one of two upper bounds of its distance is small enough. Moving by r changes a
    distance by at most r, so nothing in it is farther than its centroid is, plus the radius of its ball. And the
    distance to one triangle of b is a convex function, so its largest value is at a corner. Other triangles are
    halved across their longest edge; what cannot be decided with some 50,000 pieces counts as beyond the bound.
    """
    pieces = np.asarray(positions_a, np.float64)[indices_a].reshape(-1, 3, 3)
    others = np.asarray(positions_b, np.float64)[indices_b].reshape(-1, 3, 3)
    if len(pieces) == 0 or len(others) == 0:
        return len(pieces) == 0
    most = max(_PIECES, 2 * len(pieces))
    while 0 < len(pieces) <= most:
        centers = pieces.mean(axis=1)
        radii = np.sqrt(_square(pieces - centers[:, None]).max(axis=1))
        distances, nearest = nearest_triangles(centers, others, bound - radii)
        if distances.max() > bound:
            return False
        left = np.flatnonzero(distances + radii > bound)
        pieces, nearest = pieces[left], np.repeat(nearest[left], 3)
        corners = _point_triangle(pieces.reshape(-1, 3), others[nearest]).reshape(-1, 3)
        pieces = pieces[corners.max(axis=1, initial=0.0) > bound]
        longest = _square(pieces[:, (1, 2, 0)] - pieces).argmax(axis=1)
        rows = np.arange(len(pieces))
        start, end, apex = (pieces[rows, (longest + corner) % 3] for corner in range(3))
        middle = (start + end) / 2
        pieces = np.concatenate(
            [np.stack([start, middle, apex], axis=1), np.stack([middle, end, apex], axis=1)]
        )
    return len(pieces) == 0


def sample_points(triangles: Float64, samples: int, rng: np.random.Generator) -> Float64:
    """Return points (S, 3) on `triangles` (T, 3, 3): `samples` uniform in area, and at most as many corners."""
    edges = triangles[:, 1:] - triangles[:, :1]
    area = np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1)
    total = area.sum()
    chosen = rng.choice(len(triangles), samples, p=area / total if total > 0 else None)
    # Folding the unit square along its diagonal keeps the points uniform in the triangle.
    u, v = rng.random((2, samples, 1))
    u, v = np.where(u + v > 1, 1 - u, u), np.where(u + v > 1, 1 - v, v)
    inside = triangles[chosen, 0] + u * edges[chosen, 0] + v * edges[chosen, 1]
    corners = np.unique(triangles.reshape(-1, 3), axis=0)
    if len(corners) > samples:
        corners = rng.choice(corners, samples, replace=False)
    return np.concatenate([inside, corners])


def distances_to_triangles(points: Float64, triangles: Float64) -> Float64:
    """Return (P,) the distance of each point (P, 3) to the nearest of `triangles` (T, 3, 3), exact in float64."""
    return nearest_triangles(points, triangles)[0]


def nearest_triangles(
    points: Float64, triangles: Float64, enough: Float64 | float = -1.0
) -> tuple[Float64, NDArray[np.intp]]:
    """Return (P,) distances of points (P, 3) to `triangles` (T, 3, 3), exact in float64, and (P,) the nearest triangle.

    Triangles near each other are put into groups with boxes. The group whose middle is nearest gives each point a
    first distance; only groups with nearer boxes, and in them only triangles with nearer balls, can improve on it.
    A point that only needs to know that it is within `enough`, scalar or (P,), keeps a first distance below that.
    """
    order = _along_a_curve(triangles.mean(axis=1))
    triangles = triangles[order]
    padding = np.repeat(
        triangles[-1:], -len(triangles) % _GROUP, axis=0
    )  # the last group holds one several times
    triangles = np.concatenate([triangles, padding])
    groups = triangles.reshape(-1, 3 * _GROUP, 3)
    low, high = groups.min(axis=1), groups.max(axis=1)
    centers = triangles.mean(axis=1)
    radii = np.sqrt(_square(triangles - centers[:, None]).max(axis=1))
    middles, members = (low + high) / 2, np.arange(_GROUP)
    enough = np.broadcast_to(enough, len(points))
    result, owner = np.empty(len(points)), np.empty(len(points), np.intp)
    step = max(1, _PAIRS // len(groups))
    for start in range(0, len(points), step):
        part = points[start : start + step]
        to_middle = sum((part[:, axis, None] - middles[:, axis]) ** 2 for axis in range(3))
        first = np.argmin(to_middle, axis=1)[:, None] * _GROUP + members
        distances = _point_triangle(np.repeat(part, _GROUP, axis=0), triangles[first.reshape(-1)])
        best = distances.reshape(first.shape).argmin(axis=1)
        rows = np.arange(len(part))
        nearest, own = distances.reshape(first.shape)[rows, best], first[rows, best]
        open_ = np.flatnonzero(nearest > enough[start : start + step])
        to_box = np.zeros((len(open_), len(groups)))
        for axis in range(3):
            x = part[open_, axis, None]
            to_box += np.maximum(np.maximum(low[:, axis] - x, x - high[:, axis]), 0.0) ** 2
        point, group = np.nonzero(to_box < nearest[open_, None] ** 2)
        point = open_[point]
        for place in range(0, len(point), _PAIRS // _GROUP):
            which = np.repeat(point[place : place + _PAIRS // _GROUP], _GROUP)
            triangle = (group[place : place + _PAIRS // _GROUP, None] * _GROUP + members).reshape(-1)
            near = _square(part[which] - centers[triangle]) < (nearest[which] + radii[triangle]) ** 2
            which, triangle = which[near], triangle[near]
            distances = _point_triangle(part[which], triangles[triangle])
            nearer = np.lexsort((distances, which))[::-1]  # the nearest of each point is written last
            nearer = nearer[distances[nearer] < nearest[which[nearer]]]
            nearest[which[nearer]], own[which[nearer]] = distances[nearer], triangle[nearer]
        result[start : start + step], owner[start : start + step] = nearest, own
    return result, order[np.minimum(owner, len(order) - 1)]


def _along_a_curve(points: Float64) -> NDArray[np.intp]:
    """Return the order of `points` (N, 3) along Morton's curve: what is near on it is near in space."""
    low, high = points.min(axis=0), points.max(axis=0)
    cells = ((points - low) / np.where(high > low, high - low, 1.0) * 1023).astype(np.uint32)
    code = np.zeros(len(points), np.uint32)
    for bit in range(10):
        for axis in range(3):
            code |= ((cells[:, axis] >> np.uint32(bit)) & np.uint32(1)) << np.uint32(3 * bit + axis)
    return np.argsort(code, kind="stable")


def _point_triangle(points: Float64, triangles: Float64) -> Float64:
    """Return (N,) the distance of point i to triangle i, (N, 3) and (N, 3, 3).

    It is the distance to the plane where the foot of the perpendicular lies inside, else to the nearest edge.
    Triangles without area have no inside, and their edges are all there is.
    """
    edges = triangles[:, (1, 2, 0)] - triangles
    normal = np.cross(edges[:, 0], edges[:, 1])
    length = np.sqrt(_square(normal))
    from_corner = points[:, None] - triangles
    square = _square(edges)
    t = np.einsum("nij,nij->ni", from_corner, edges) / np.where(square > 0, square, 1.0)
    along = np.clip(t, 0.0, 1.0)[:, :, None] * edges
    edge = np.sqrt(_square(from_corner - along).min(axis=1))
    # The foot is inside where it lies left of every edge, seen against the normal.
    left = np.einsum("nij,nij->ni", np.cross(normal[:, None], edges), from_corner) >= 0
    inside = left.all(axis=1) & (length > 0)
    height = np.abs(np.einsum("ni,ni->n", from_corner[:, 0], normal)) / np.where(length > 0, length, 1.0)
    return np.where(inside, height, edge)


def _square(vectors: Float64) -> Float64:
    """Return the squared lengths (...) of vectors (..., 3)."""
    return np.einsum("...i,...i->...", vectors, vectors)
