"""The order of a scene's triangles in which each meshlet is a contiguous part of the list.

Four steps order the triangles of all meshes at once:

1. Regions. A mesh is halved along the widest axis of its triangles, again and again, down to regions of a few dozen
   meshlets. Cuts are at whole meshlets, by an estimate of the triangles that fit into one.
2. Islands. Triangles of a region that are connected by vertices are an island. The two sides of a wall are two
   islands, so that few meshlets mix them. Islands much smaller than a meshlet stay whole from here on.
3. Cells. Islands, and all small islands of a region together, are halved like meshes, down to two meshlets.
4. Strips. A cell is cut into parallel strips as wide as a meshlet, and the triangles follow the strips back and forth
   (Leutenegger et al. 1997, "STR: A Simple and Efficient Algorithm for R-Tree Packing").

`build.py` then cuts the list into meshlets.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from common.scene import Float32, Float64, UInt32

from .groups import Int64, group_starts, previous_use, sizes_of, sorting_order, spans

REGION = 32
"""Meshlets of a region. Larger regions mix distant islands in a meshlet, smaller ones cut islands apart."""

CELL = 2
"""Meshlets of a cell. Larger cells have fewer corners on flat grids, smaller ones follow bent surfaces better."""

SMALL = 0.3
"""Meshlets of the largest island that stays whole."""

_RIM = 2.0
"""A patch of t triangles of a closed surface has this many times sqrt(t) vertices beyond its share of the mesh, because
of its rim; measured on models."""


@dataclass(frozen=True)
class Order:
    """`triangles` (T,) in their new order. `regions` (R,) and `cells` (C,) are the places where one begins.

    Meshlets never cross the end of a region, and avoid crossing that of a cell.
    """

    triangles: Int64
    regions: Int64
    cells: Int64


@dataclass(frozen=True)
class _Parts:
    """Parts of the list of triangles: the first of each, how many, and about how many meshlets they need."""

    first: Int64
    count: Int64
    meshlets: NDArray[np.float64]

    def halved(self, which: NDArray[np.bool_]) -> _Parts:
        """Return the parts with two halves in the place of each of `which`; the left one has whole meshlets."""
        left = np.floor(self.meshlets / 2)
        middle = np.round(self.count * left / self.meshlets).astype(np.int64)
        middle = np.where(which, np.clip(middle, 1, self.count - 1), 0)
        left = np.where(which, left, 0.0)
        kept = np.stack([which, np.ones(len(which), bool)], axis=1)
        return _Parts(
            np.stack([self.first, self.first + middle], axis=1)[kept],
            np.stack([middle, self.count - middle], axis=1)[kept],
            np.stack([left, self.meshlets - left], axis=1)[kept],
        )

    def numbers(self) -> Int64:
        """Return (T,) the part of each triangle in the list."""
        return np.repeat(np.arange(len(self.first)), self.count)


def order_triangles(
    positions: Float32, triangles: UInt32, starts: Int64, max_vertices: int, max_triangles: int
) -> Order:
    """Return an order of triangles (T, 3), numbers of `positions` (V, 3), for the meshes that begin at `starts` (M,).

    Every mesh keeps its place in the list and has at least one triangle. Places that are not finite count as 0.
    """
    places = _box_centres(positions, triangles)
    meshes = _estimated(triangles, starts, max_vertices, max_triangles)
    order, regions = _split(places, np.arange(len(triangles)), meshes, REGION)
    order, parts = _by_island(triangles, places, order, regions)
    order, cells = _split(places, order, parts, CELL)
    return Order(_in_strips(places, order, cells), regions.first, cells.first)


def halved_to(most: int, positions: Float32, triangles: UInt32) -> tuple[Int64, Int64]:
    """Return an order of the triangles of a huge mesh, and where its parts of at most so many triangles begin."""
    start, count = np.zeros(1, np.int64), len(triangles)
    whole = _Parts(start, start + count, np.array([2 * count / most]))
    order, parts = _split(_box_centres(positions, triangles), np.arange(count), whole, 2)
    return order, parts.first


def _estimated(triangles: UInt32, starts: Int64, max_vertices: int, max_triangles: int) -> _Parts:
    """Return the meshes as parts.

    A mesh has q vertices a triangle, and a patch of t triangles q t + r sqrt(t). On closed surfaces q is 1/2 and r is
    `_RIM`; where each triangle has vertices of its own, q is 3 and there is no rim.
    """
    counts = sizes_of(starts, len(triangles))
    first_use = previous_use(triangles.reshape(-1)) < np.repeat(3 * starts, 3 * counts)
    q = np.add.reduceat(first_use, 3 * starts, dtype=np.int64) / counts
    rim = _RIM * (3 - q) / 2.5
    root = (np.sqrt(rim**2 + 4 * q * max_vertices) - rim) / (2 * q)
    fitting = np.clip(np.floor(root**2 + 1e-6), 1, max_triangles)
    return _Parts(starts, counts, np.ceil(counts / fitting))


def _split(places: Float32, order: Int64, parts: _Parts, most: float) -> tuple[Int64, _Parts]:
    """Halve parts along their widest axis until each needs at most `most` meshlets (2 or more)."""
    order = order.copy()
    while (large := (parts.meshlets > most) & (parts.count > 1)).any():
        counts = parts.count[large]
        inside = spans(parts.first[large], counts)
        part = np.repeat(np.arange(len(counts)), counts)
        boxes = _boxes(places, order[inside], np.cumsum(counts) - counts)
        steps = _steps(places, order[inside], part, boxes[1].argmax(axis=0), boxes)
        order[inside] = order[inside][sorting_order(steps, part)]
        parts = parts.halved(large)
    return order, parts


def _by_island(triangles: UInt32, places: Float32, order: Int64, regions: _Parts) -> tuple[Int64, _Parts]:
    """Return the triangles by island, and the parts that may be cut; those of small islands move to its middle."""
    region = regions.numbers()
    island = islands(triangles[order].reshape(-1), np.repeat(regions.first, regions.count))
    by_island = sorting_order(island)
    order, starts = order[by_island], group_starts(island[by_island])
    counts = sizes_of(starts, len(order))
    region_of = region[starts]  # an island is named after its first triangle, so regions stay in order
    share = regions.meshlets / regions.count
    small = counts * share[region_of] <= SMALL

    of = np.repeat(np.arange(len(starts)), counts)
    own = np.take(places, order, axis=1)
    middles = np.minimum.reduceat(own, starts, axis=1) / 2 + np.maximum.reduceat(own, starts, axis=1) / 2
    places[:, order] = np.where(small[of], middles[:, of], own)

    # In each region the small islands come first, as one part, and then each of the others.
    part = np.where(small, regions.first[region_of], len(order) + np.arange(len(starts)))
    moved = sorting_order(part, region_of)
    order = order[spans(starts[moved], counts[moved])]
    begins = group_starts(part[moved])
    first = (np.cumsum(counts[moved]) - counts[moved])[begins]
    count = sizes_of(first, len(order))
    return order, _Parts(first, count, count * share[region[first]])


def islands(vertices: UInt32, begins: Int64) -> Int64:
    """Return (T,) the first triangle that each is connected to by shared vertices, in the part that begins at `begins`.

    `vertices` (3 T,) are those of the list, `begins` (T,) the first triangle of the part around each. Each round hooks
    the later of two islands that share a vertex to the earlier one, and then shortens the paths: the rounds are about
    the logarithm of the longest chain (Shiloach and Vishkin 1982, "An O(log n) Parallel Connectivity Algorithm").
    """
    previous = previous_use(vertices)
    corners = np.flatnonzero(previous >= np.repeat(3 * begins, 3))
    a, b = corners // 3, previous[corners] // 3
    first = np.arange(len(begins))
    while True:
        of_a, of_b = first[a], first[b]
        apart = of_a != of_b
        if not apart.any():
            return first
        a, b, of_a, of_b = a[apart], b[apart], of_a[apart], of_b[apart]
        np.minimum.at(first, np.maximum(of_a, of_b), np.minimum(of_a, of_b))
        while ((shorter := first[first]) != first).any():
            first = shorter


def _in_strips(places: Float32, order: Int64, cells: _Parts) -> Int64:
    """Return the triangles with each cell in strips along its longest axis, next to each other along the second."""
    boxes = _boxes(places, order, cells.first)
    axes = np.argsort(-boxes[1], axis=0, kind="stable")
    length, width = boxes[1][axes[:2], np.arange(len(cells.first))]
    # A cell that is l long and w wide has n squares of side sqrt(l w / n).
    ratio = np.divide(width, length, out=np.zeros_like(width), where=length > 0)
    strips = np.maximum(np.round(np.sqrt(cells.meshlets * ratio)), 1.0).astype(np.int64)
    cell = cells.numbers()
    order = order[sorting_order(_steps(places, order, cell, axes[1], boxes), cell)]
    strip = (np.arange(len(order)) - cells.first[cell]) * strips[cell] // cells.count[cell]
    steps = _steps(places, order, cell, axes[0], boxes)
    back_and_forth = np.where(strip % 2 == 1, ~steps, steps)
    return order[sorting_order(back_and_forth, (np.cumsum(strips) - strips)[cell] + strip)]


def _boxes(places: Float32, order: Int64, starts: Int64) -> tuple[Float64, Float64]:
    """Return the lower corners and the sizes (3, P) of the boxes of parts of a list of triangles, begun at `starts`."""
    own = np.take(places, order, axis=1)
    low = np.minimum.reduceat(own, starts, axis=1).astype(np.float64)
    return low, np.maximum.reduceat(own, starts, axis=1) - low


def _steps(
    places: Float32, order: Int64, part: Int64, axis: Int64, boxes: tuple[Float64, Float64]
) -> NDArray[np.uint16]:
    """Return how far triangles are along the `axis` (P,) of the box of their part, in steps of 1/65535 of it."""
    low, size = (corner[axis, np.arange(len(axis))] for corner in boxes)
    scale = np.divide(65535.0, size, out=np.zeros_like(size), where=size > 0)
    return ((places[axis[part], order] - low[part]) * scale[part]).astype(np.uint16)


def _box_centres(positions: Float32, triangles: UInt32) -> Float32:
    """Return (3, T) the middles of the triangles' boxes.

    The two triangles of a quad have the same box, so that they are sorted next to each other; by their centroids whole
    rows of them would be parted.
    """
    centres = np.empty((3, len(triangles)), np.float32)
    for axis in range(3):
        a, b, c = np.ascontiguousarray(positions[:, axis])[triangles.T]
        centres[axis] = np.minimum(np.minimum(a, b), c) / 2 + np.maximum(np.maximum(a, b), c) / 2
    centres[~np.isfinite(centres)] = 0.0
    return centres
