"""How meshlets and vertices are packed into words for the GPU.

A meshlet's data is one uint32 for each vertex, its number in the mesh, and then one byte for each corner of its
triangles, its number among these vertices: four bytes a word, the first in the low bits.

Small normals and texture coordinates are a study of bytes: the chapter draws with the scene's own vertices. A normal of
three bytes is at most 0.39 degrees off, and a coordinate in half precision has 11 significant bits.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from common.scene import Float32, Float64, UInt32

from .groups import Int64, Ints, group_starts, sizes_of, sorting_order, spans

MOST_IN_RECORD = 255
"""Most vertices that the record of a meshlet can count."""

NO_CONE = 127
"""The cutoff of a meshlet that no direction culls."""

_SLACK = 1e-6
"""Added to the cutoff before it is rounded up: far more than the rounding errors of the float64 cones."""


def pack_words(corners: UInt32, starts: Int64) -> tuple[UInt32, Int64, Int64]:
    """Return the words (W,) of meshlets, the first word of each (K,), and its number of vertices (K,).

    `corners` (3 T,) are the vertices of triangles, relative to their mesh. A meshlet begins at each triangle of
    `starts` (K,), and has at most 256 vertices, which are numbered in the order of their first use.
    """
    if not len(starts):
        return np.zeros(0, np.uint32), np.zeros(0, np.int64), np.zeros(0, np.int64)
    triangle_counts = sizes_of(starts, len(corners) // 3)
    meshlet = np.repeat(np.arange(len(starts)), 3 * triangle_counts)
    order = sorting_order(
        corners, meshlet
    )  # equal vertices of a meshlet are neighbours, the first use in front
    groups = group_starts((meshlet[order] << 32) | corners[order])
    first_use = np.zeros(len(corners), bool)
    first_use[order[groups]] = True
    vertex_counts = np.add.reduceat(first_use, 3 * starts, dtype=np.int64)
    data = _data_places(vertex_counts, triangle_counts)
    words = np.zeros(data[-1], np.uint32)
    # The number of a vertex in its meshlet is the number of first uses before it.
    number = (
        np.cumsum(first_use) - 1 - np.repeat(np.cumsum(vertex_counts) - vertex_counts, 3 * triangle_counts)
    )
    words[data[meshlet[first_use]] + number[first_use]] = corners[first_use]
    local = np.empty(len(corners), np.uint8)
    local[order] = np.repeat(number[order[groups]], sizes_of(groups, len(corners)))
    words.view(np.uint8)[spans(4 * (data[:-1] + vertex_counts), 3 * triangle_counts)] = local
    return words, data[:-1], vertex_counts


def unpack_words(records: np.ndarray, words: UInt32) -> UInt32:
    """Return the corners (3 T,) of the triangles of `records` (K,) MESHLET, relative to their meshes."""
    vertex_counts, triangle_counts = unpack_counts(records["counts"])
    data = records["data"].astype(np.int64)
    local = words.view(np.uint8)[spans(4 * (data + vertex_counts), 3 * triangle_counts)]
    return words[np.repeat(data, 3 * triangle_counts) + local]


def _data_places(vertex_counts: Int64, triangle_counts: Int64) -> Int64:
    """Return (K + 1,) the first word of each meshlet, and the number of all."""
    return np.cumsum(np.append(0, vertex_counts + -(-3 * triangle_counts // 4)))


def pack_counts(vertices: Ints, triangles: Ints) -> UInt32:
    """Return vertices | triangles << 8."""
    return (vertices | triangles << 8).astype(np.uint32)


def unpack_counts(counts: UInt32) -> tuple[Int64, Int64]:
    """Return the numbers of vertices and triangles."""
    return (counts & 255).astype(np.int64), (counts >> 8).astype(np.int64)


def pack_cones(axes: Float64, sines: Float64) -> UInt32:
    """Return cones of axes (K, 3) and sines of half angles (K,) as four signed bytes: x, y, z, cutoff, each times 127.

    Let c be the centre and r the radius of the meshlet, e the eye, u the direction from e to c, and n a normal within
    the angle alpha of the axis a. A triangle faces away if n . (v - e) >= 0, for which n . u |c - e| >= r is enough,
    since its vertex v is within r of c. If a . u >= sin(alpha) + s, then n . u >= s: with beta between a and u, the
    difference cos(beta) - cos(alpha + beta) rises with beta up to sin(alpha), at beta = 90 degrees - alpha. So

        a . (c - e) >= sin(alpha) |c - e| + r

    culls conservatively. The bytes are another axis b, for which a . u >= b . u - |a - b|. Hence the cutoff is
    sin(alpha) + |a - b|, rounded up. A cutoff of 127 means that the meshlet is never culled; then the axis is 0.
    """
    rounded = np.round(127 * axes)
    cutoff = np.ceil(127 * (sines + np.linalg.norm(rounded / 127 - axes, axis=1) + _SLACK))
    never = ~(cutoff < NO_CONE)
    packed = np.empty((len(axes), 4), np.int8)
    packed[:, :3] = np.where(never[:, None], 0.0, rounded)
    packed[:, 3] = np.where(never, NO_CONE, cutoff)
    return packed.view("<u4").reshape(-1).astype(np.uint32)


def unpack_cones(cones: UInt32) -> tuple[Float64, Float64]:
    """Return the axes (K, 3) and cutoffs (K,) of packed cones, as shaders decode them."""
    values = np.ascontiguousarray(cones, "<u4").view(np.int8).reshape(-1, 4) / 127.0
    return values[:, :3], values[:, 3]


# --- packed vertices ---


def pack_normal(normals: NDArray[np.floating[Any]]) -> NDArray[np.uint8]:
    """Return unit vectors (N, 3) as bytes, round((n + 1) * 127): -1, 0 and 1 are exact, 255 is not used."""
    return np.round((np.clip(normals, -1.0, 1.0) + 1.0) * 127).astype(np.uint8)


def unpack_normal(packed: NDArray[np.uint8]) -> Float32:
    """Return the unit vectors (N, 3) of packed ones."""
    vectors = packed / np.float32(127) - np.float32(1)
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)


def pack_uv(uv: Float32) -> NDArray[np.uint16]:
    """Return texture coordinates as the bits of the nearest numbers of half precision, ties to even."""
    with np.errstate(over="ignore"):  # above 65520 it is infinite
        return uv.astype(np.float16).view(np.uint16)


def unpack_uv(packed: NDArray[np.uint16]) -> Float32:
    """Return the texture coordinates of packed ones, exactly."""
    return packed.view(np.float16).astype(np.float32)
