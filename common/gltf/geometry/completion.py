"""What a file leaves out of a surface: flat normals, tangents from uv derivatives, a frame where no uv is."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from common.scene import Float32, Float64, UInt32

_BATCH = 1 << 12
"""Triangles whose tangents are computed at once: what that takes beside them stays within a processor's cache."""


def triangle_normals(positions: Float32, indices: UInt32) -> Float64:
    """Return (T, 3) the normals of triangles with their area as length; zero where a triangle has no area."""
    a, b, c = (positions[indices[corner::3]].astype(np.float64) for corner in range(3))
    return np.cross(b - a, c - a) / 2


def unit(vectors: Float32 | Float64, fallback: tuple[float, float, float] = (0.0, 0.0, 1.0)) -> Float64:
    """Return (N, 3) vectors with length 1; `fallback` in the place of those with none."""
    x, y, z = np.abs(vectors).T
    largest = np.maximum(np.maximum(x, y), z)[
        :, None
    ]  # numpy's own maximum of so short an axis takes ten times as long
    some = largest > 0
    scaled = vectors.astype(np.float64) / np.where(some, largest, 1.0)  # squares of tiny lengths would vanish
    if not some.all():
        scaled = np.where(some, scaled, fallback)
    return scaled / np.sqrt(np.einsum("ij,ij->i", scaled, scaled))[:, None]


def flat_normals(positions: Float32) -> Float32:
    """Return (V, 3) normals of unshared vertices, three to a triangle: glTF's rule where none are given."""
    corners = np.arange(len(positions), dtype=np.uint32)
    return np.repeat(unit(triangle_normals(positions, corners)), 3, axis=0).astype(np.float32)


def smooth_normals(positions: Float32, indices: UInt32) -> Float32:
    """Return (V, 3) normals averaged by area; they stand in for single normals without a direction."""
    return unit(
        _sum_at(indices, np.repeat(triangle_normals(positions, indices), 3, axis=0), len(positions))
    ).astype(np.float32)


def _sum_at(indices: UInt32 | np.ndarray, values: Float64, count: int) -> Float64:
    """Return (count, 3) sums of (N, 3) values by index; bincount is ten times as fast as np.add.at."""
    return np.stack([np.bincount(indices, values[:, axis], count) for axis in range(3)], axis=1)


def any_tangents(normals: Float32) -> Float32:
    """Return (V, 4) tangents perpendicular to unit normals, where nothing depends on their direction.

    Duff et al., "Building an Orthonormal Basis, Revisited" (JCGT 2017): no branch and no normal it fails for.
    """
    x, y, z = normals[:, 0], normals[:, 1], normals[:, 2]
    sign = np.copysign(np.float32(1), z)
    a = -1 / (sign + z)
    tangents = np.empty((len(normals), 4), np.float32)
    tangents[:, 0] = 1 + sign * x * x * a
    tangents[:, 1] = sign * x * y * a
    tangents[:, 2] = -sign * x
    tangents[:, 3] = 1
    return tangents


def generate_tangents(
    positions: Float32, normals: Float64, uv: Float64, indices: UInt32
) -> tuple[UInt32, Float32, UInt32]:
    """Return (source, tangents, indices): tangents along increasing u, from the derivatives of `uv` (V, 2).

    `source` (V',) names the vertex that each new one copies, tangents (V', 4) float32 with the handedness in
    w, and `indices` (T*3,) count the new vertices. A vertex whose triangles disagree about the handedness,
    where a texture is mirrored, becomes two. Vertices equal in position, normal and uv share their tangent
    even where the file stores them apart.

    As in MikkTSpace (Mikkelsen, "Simulation of Wrinkled Surfaces Revisited", 2008) every triangle's tangent
    is projected onto the plane of the vertex normal, normalised and weighted by the angle of its corner.
    Unlike it, all triangles of one handedness at a vertex are averaged, not only those connected over edges,
    the bitangent's length is not kept, and a quad is two triangles. So a map baked with MikkTSpace differs
    slightly where several uv islands touch one vertex.
    """
    # One place for each (distinct vertex, handedness).
    keys = np.concatenate([positions, normals, uv], axis=1, dtype=np.float32, casting="same_kind")
    keys += np.float32(0)  # -0 equals 0
    weld, distinct = _welded(keys)
    del keys
    count = len(indices) // 3
    place, direction = np.empty((3, count), np.intp), np.empty((3, 3, count))
    mirrored, flat = np.empty(count, bool), np.empty(count, bool)
    points: list[Any] = [np.ascontiguousarray(values.T) for values in (positions, normals, uv)]
    for first in range(0, count, _BATCH):
        some = slice(first, min(first + _BATCH, count))
        # Axes come first and triangles last, so that numpy's inner loops are long.
        corners = np.ascontiguousarray(indices[3 * some.start : 3 * some.stop].reshape(-1, 3).T, np.intp)
        direction[..., some], area = _directions(points, corners)
        # v runs down the image and the bitangent w (n x t) up, so a picture seen the right way round has area <
        # 0, w = 1.
        mirrored[some], flat[some] = area > 0, area == 0
        place[:, some] = weld[corners] * 2 + mirrored[some]
    total = _sum_at(place.reshape(-1), direction.reshape(3, -1).T, 2 * distinct)
    del direction, points

    # Triangles without area in uv say nothing and take the side that their vertex has anyway.
    named, corner_mirrored = indices.reshape(-1, 3).T, np.broadcast_to(mirrored, (3, count))
    if flat.any():
        sides = np.zeros((distinct, 2), bool)
        sides.reshape(-1)[place[:, ~flat]] = True
        only_mirrored = sides[:, 1] & ~sides[:, 0]
        corner_mirrored = np.where(flat, only_mirrored[place >> 1], mirrored)
    del place

    # A vertex keeps its place for its first side; the second side is appended.
    vertex_sides = np.zeros((2, len(positions)), bool)
    vertex_sides[0, named[~corner_mirrored]] = True
    vertex_sides[1, named[corner_mirrored]] = True
    both = vertex_sides[0] & vertex_sides[1]
    split = np.flatnonzero(both).astype(np.uint32)
    source = np.concatenate([np.arange(len(positions), dtype=np.uint32), split])
    side = np.concatenate([vertex_sides[1] & ~both, np.ones(len(split), bool)])
    new_indices = indices.copy()
    if len(split):
        appended = np.zeros(len(positions), np.uint32)
        appended[split] = np.arange(len(positions), len(source), dtype=np.uint32)
        moves = (corner_mirrored & both[named]).T.reshape(-1)
        new_indices[moves] = appended[indices[moves]]

    sums = total[weld[source] * 2 + side]
    tangents = any_tangents(normals[source].astype(np.float32))
    valid = (np.abs(sums) > 1e-12).any(axis=1)
    tangents[valid, :3] = unit(sums[valid])
    tangents[:, 3] = np.where(side, -1, 1)
    return source, tangents, new_indices


def _directions(points: list[Any], corners: NDArray[np.intp]) -> tuple[Float64, Float64]:
    """Return (3, 3, T) what triangles add to the tangents of their corners, and (T,) twice their areas in uv.

    `points` are positions, normals and uv, each (C, V) float32 or float64, and `corners` (3, T).
    """
    positions, normals, uv = points
    edges, turns = _edges(positions, corners), _edges(uv, corners)
    (u1, v1), (u2, v2) = turns[:, 0], -turns[:, 2]
    area = u1 * v2 - u2 * v1
    # dp/du = (e0 dv1 - e1 dv0) / area; the length does not matter, its sign does.
    along_u = _scaled((edges[:, 0] * v2 + edges[:, 2] * v1) * np.sign(area))
    normal = _at(normals, corners)  # (3, 3, T)
    direction = along_u[:, None] - normal * _dot(normal, along_u[:, None])
    length = np.sqrt(_dot(direction, direction))
    direction *= np.divide(_corner_angles(edges), length, out=np.zeros_like(length), where=length > 0)
    return direction, area


def _welded(rows: Float32) -> tuple[NDArray[np.intp], int]:
    """Return for each of the rows (V, C) which distinct one it is, and how many those are.

    Sorted by a hash of 64 bits instead of by all their numbers, in a fifth of the time; which of them are equal,
    neighbours say. Were two unlike rows to have one hash, rows between them would count as distinct once more.
    """
    bits = np.ascontiguousarray(rows).view(np.uint32)
    hashes = np.zeros(len(bits), np.uint64)
    for column in bits.T:
        hashes = (hashes ^ column) * np.uint64(0x9E3779B97F4A7C15)
        hashes ^= hashes >> np.uint64(29)
    order = np.argsort(hashes)
    ordered = bits[order]
    begins = np.ones(len(bits), bool)
    begins[1:] = (ordered[1:] != ordered[:-1]).any(axis=1)
    numbers = np.cumsum(begins) - 1
    welded = np.empty_like(numbers)
    welded[order] = numbers
    return welded, int(begins.sum())


def _at(points: Any, corners: NDArray[np.intp]) -> Float64:
    """Return (C, 3, T) the `points` (C, V) of corners (3, T); they become longer numbers only here, a few at a time."""
    corner_points: Float64 = points.take(corners, axis=1).astype(np.float64, copy=False)
    return corner_points


def _edges(points: Any, corners: NDArray[np.intp]) -> Float64:
    """Return (C, 3, T) the edges of triangles with the corners (3, T) of `points` (C, V): each to the next corner."""
    at = _at(points, corners)
    return at[:, (1, 2, 0)] - at


def _dot(a: Float64, b: Float64) -> Float64:
    """Return the dot products of vectors whose components are along the first axis."""
    product: Float64 = a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
    return product


def _scaled(vectors: Float64) -> Float64:
    """Return vectors (3, ..., N), each N divided by the largest of its numbers, lest squares of tiny ones vanish."""
    largest = np.abs(vectors).reshape(-1, vectors.shape[-1]).max(axis=0, initial=0.0)
    return vectors / np.where(largest > 0, largest, 1.0)


def _corner_angles(edges: Float64) -> Float64:
    """Return (3, T) the angles of triangles, of which `edges` are (3, 3, T); zero where an edge has no length."""
    x, y, z = edges = _scaled(edges)
    x0, y0, z0, x2, y2, z2 = x[0], y[0], z[0], x[2], y[2], z[2]
    across = np.sqrt((y0 * z2 - z0 * y2) ** 2 + (z0 * x2 - x0 * z2) ** 2 + (x0 * y2 - y0 * x2) ** 2)
    return np.arctan2(across, -_dot(edges, edges[:, (2, 0, 1)]))
