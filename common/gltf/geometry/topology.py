"""Every mode of a glTF primitive as triangles: strips, fans, and thin solids for points and lines.

A result names *corners*: `source[i]` is the vertex of the file that new vertex i copies, so any attribute
follows by `attribute[source]`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from common.scene import Float32, UInt32

POINTS, LINES, LINE_LOOP, LINE_STRIP, TRIANGLES, TRIANGLE_STRIP, TRIANGLE_FAN = range(7)

LINE_WIDTH = 1 / 100
"""Width of a line as a part of the diagonal of its primitive's bounds: about a pixel of a small picture."""
POINT_WIDTH = 1 / 40
"""Diameter of a point, likewise."""

_OCTAHEDRON = np.array(
    [(1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0), (0, 0, 1), (0, 0, -1)],
    np.float32,
)
_OCTAHEDRON_INDICES = np.array(
    [(0, 2, 4), (2, 1, 4), (1, 3, 4), (3, 0, 4), (2, 0, 5), (1, 2, 5), (3, 1, 5), (0, 3, 5)],
    np.uint32,
)
# Corners 0..3 run round the start of a line, 4..7 round its end; counter-clockwise seen from outside.
_PRISM_INDICES = np.array(
    [
        *[(0, 1, 5), (0, 5, 4), (1, 2, 6), (1, 6, 5), (2, 3, 7), (2, 7, 6), (3, 0, 4), (3, 4, 7)],
        *[(0, 2, 1), (0, 3, 2), (4, 5, 6), (4, 6, 7)],  # the ends
    ],
    np.uint32,
)


@dataclass(frozen=True)
class Solid:
    """Points or lines as thin solids: `source` (V,) vertices of the file, `offset` (V, 3) from them."""

    source: UInt32
    offset: Float32
    normals: Float32
    indices: UInt32


def triangle_indices(indices: UInt32, mode: int) -> UInt32:
    """Return the (T*3,) indices of a triangle list, strip or fan, wound as glTF 2.0 (3.7.2.1) says.

    The repeated indices that glue strips together are dropped; a list keeps every triangle it has. What is
    left over at the end of a list is ignored.
    """
    if mode == TRIANGLES:
        rest = len(indices) % 3
        return indices[: len(indices) - rest] if rest else indices
    count = max(len(indices) - 2, 0)
    first = np.arange(count)
    if mode == TRIANGLE_STRIP:
        odd = first % 2
        corners = (first, first + 1 + odd, first + 2 - odd)
    else:
        corners = (first + 1, first + 2, np.zeros_like(first))
    triangles = np.stack([indices[corner] for corner in corners], axis=1).reshape(-1, 3)
    a, b, c = triangles.T
    return np.ascontiguousarray(triangles[(a != b) & (b != c) & (c != a)].reshape(-1))


def line_ends(indices: UInt32, mode: int) -> UInt32:
    """Return (L, 2) the vertices at the ends of every line."""
    if mode == LINES:
        return indices[: len(indices) // 2 * 2].reshape(-1, 2)
    ends = np.stack([indices[:-1], indices[1:]], axis=1)
    if mode == LINE_LOOP and len(indices) > 2:
        ends = np.concatenate([ends, [[indices[-1], indices[0]]]]).astype(np.uint32)
    return ends


def solid_points(positions: Float32, indices: UInt32) -> Solid:
    """Return an octahedron round every point: triangles that show from any side and that rays can hit."""
    radius = POINT_WIDTH / 2 * _diagonal(positions, indices)
    count = len(indices)
    return Solid(
        source=np.repeat(indices, 6),
        offset=np.tile(_OCTAHEDRON * np.float32(radius), (count, 1)),
        normals=np.tile(_OCTAHEDRON, (count, 1)),
        indices=_copies(_OCTAHEDRON_INDICES, count, 6),
    )


def solid_lines(positions: Float32, ends: UInt32) -> Solid:
    """Return a square prism along every line, closed at both ends."""
    radius = LINE_WIDTH / 2 * _diagonal(positions, ends.reshape(-1))
    start, stop = positions[ends[:, 0]].astype(np.float64), positions[ends[:, 1]].astype(np.float64)
    axis = stop - start
    length = np.linalg.norm(axis, axis=1, keepdims=True)
    axis = np.where(length > 0, axis / np.where(length > 0, length, 1.0), (0.0, 0.0, 1.0))
    # The coordinate axis that the line is farthest from gives a well-conditioned cross product.
    helper = np.eye(3)[np.abs(axis).argmin(axis=1)]
    side = np.cross(axis, helper)
    side /= np.linalg.norm(side, axis=1, keepdims=True)
    up = np.cross(axis, side)
    # side x up = axis, so these four run counter-clockwise seen against the line's direction.
    ring = np.stack([side, up, -side, -up], axis=1)
    normals = np.concatenate([ring, ring], axis=1).reshape(-1, 3)
    return Solid(
        source=np.repeat(ends, 4, axis=1).reshape(-1),
        offset=(normals * radius).astype(np.float32),
        normals=normals.astype(np.float32),
        indices=_copies(_PRISM_INDICES, len(ends), 8),
    )


def _diagonal(positions: Float32, indices: UInt32) -> float:
    if len(indices) == 0:
        return 1.0
    used = positions[indices].astype(np.float64)
    return float(np.linalg.norm(used.max(axis=0) - used.min(axis=0))) or 1.0


def _copies(indices: UInt32, count: int, vertices: int) -> UInt32:
    """Return (count * T * 3,) the indices of `count` copies of a shape that has `vertices` vertices."""
    first = np.arange(count, dtype=np.uint32) * np.uint32(vertices)
    return (first[:, None] + indices.reshape(1, -1)).reshape(-1)
