"""What a file leaves out of a surface: flat normals, tangents from uv derivatives, a frame where no uv is."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from common.scene import Float32, Float64, UInt32


def triangle_normals(positions: Float32, indices: UInt32) -> Float64:
    """Return (T, 3) the normals of triangles with their area as length; zero where a triangle has no area."""
    a, b, c = (positions[indices[corner::3]].astype(np.float64) for corner in range(3))
    return np.cross(b - a, c - a) / 2


def unit(vectors: Float32 | Float64, fallback: tuple[float, float, float] = (0.0, 0.0, 1.0)) -> Float64:
    """Return (N, 3) vectors with length 1; `fallback` in the place of those with none."""
    largest = np.abs(vectors).max(axis=1, keepdims=True, initial=0.0)
    scaled = vectors.astype(np.float64) / np.where(
        largest > 0, largest, 1.0
    )  # squares of tiny lengths would vanish
    scaled = np.where(largest > 0, scaled, fallback)
    return scaled / np.linalg.norm(scaled, axis=1, keepdims=True)


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
    corner_positions = positions[indices].astype(np.float64).reshape(-1, 3, 3)
    corner_uv = uv[indices].astype(np.float64).reshape(-1, 3, 2)
    edges = corner_positions[:, 1:] - corner_positions[:, :1]  # (T, 2, 3)
    turns = corner_uv[:, 1:] - corner_uv[:, :1]  # (T, 2, 2)
    area = turns[:, 0, 0] * turns[:, 1, 1] - turns[:, 1, 0] * turns[:, 0, 1]
    # dp/du = (e0 dv1 - e1 dv0) / area; the length does not matter, its sign does.
    along_u = (edges[:, 0] * turns[:, 1, 1, None] - edges[:, 1] * turns[:, 0, 1, None]) * np.sign(area)[
        :, None
    ]
    # v runs down the image and the bitangent w (n x t) up, so a picture seen the right way round has area <
    # 0, w = 1.
    mirrored = area > 0

    # One place for each (distinct vertex, handedness).
    keys = np.concatenate([positions, normals, uv], axis=1).astype(np.float32) + np.float32(0)  # -0 equals 0
    rows = np.ascontiguousarray(keys).view(f"V{keys.shape[1] * 4}")[:, 0]
    distinct, weld = np.unique(rows, return_inverse=True)
    corner_mirrored = np.repeat(mirrored, 3)
    place = weld[indices] * 2 + corner_mirrored

    corner_normals = normals[indices].astype(np.float64)
    direction = np.repeat(along_u, 3, axis=0)
    direction = direction - corner_normals * (corner_normals * direction).sum(axis=1, keepdims=True)
    usable: NDArray[np.bool_] = np.abs(direction).max(axis=1, initial=0.0) > 0
    direction = np.where(usable[:, None], unit(direction), 0.0)
    total = _sum_at(place, direction * _corner_angles(corner_positions)[:, None], 2 * len(distinct))

    # Triangles without area in uv say nothing and take the side that their vertex has anyway.
    flat = np.repeat(area == 0, 3)
    sides = np.zeros((len(distinct), 2), bool)
    sides[weld[indices[~flat]], corner_mirrored[~flat].astype(np.intp)] = True
    only_mirrored = (sides[:, 1] & ~sides[:, 0])[weld[indices]]
    corner_mirrored = np.where(flat, only_mirrored, corner_mirrored)

    # A vertex keeps its place for its first side; the second side is appended.
    vertex_sides = np.zeros((len(positions), 2), bool)
    vertex_sides[indices, corner_mirrored.astype(np.intp)] = True
    both = vertex_sides[:, 0] & vertex_sides[:, 1]
    split = np.flatnonzero(both).astype(np.uint32)
    source = np.concatenate([np.arange(len(positions), dtype=np.uint32), split])
    mirrored_side = vertex_sides[:, 1] & ~vertex_sides[:, 0]
    side = np.concatenate([mirrored_side, np.ones(len(split), bool)])
    appended = np.zeros(len(positions), np.uint32)
    appended[split] = np.arange(len(positions), len(source), dtype=np.uint32)
    moves = corner_mirrored & both[indices]
    new_indices = np.where(moves, appended[indices], indices).astype(np.uint32)

    sums = total[weld[source] * 2 + side]
    tangents = any_tangents(normals[source].astype(np.float32))
    found: NDArray[np.bool_] = np.abs(sums).max(axis=1, initial=0.0) > 1e-12
    tangents[found, :3] = unit(sums[found])
    tangents[:, 3] = np.where(side, -1, 1)
    return source, tangents, new_indices


def _corner_angles(corners: Float64) -> Float64:
    """Return (T*3,) the angles of triangles (T, 3, 3); zero where a triangle has no area."""
    angles = np.empty((len(corners), 3))
    for corner in range(3):
        a = unit(corners[:, (corner + 1) % 3] - corners[:, corner])
        b = unit(corners[:, (corner + 2) % 3] - corners[:, corner])
        angles[:, corner] = np.arctan2(np.linalg.norm(np.cross(a, b), axis=1), (a * b).sum(axis=1))
    return angles.reshape(-1)
