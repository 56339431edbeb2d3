"""The builder of meshlets: triangles ordered in space (`order.py`), then cut where a meshlet is full.

Numpy works on many meshes at once: no loop runs over meshes or meshlets, only over batches of 2^18 triangles.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from common.errors import SceneError
from common.scene import Float32, Scene, UInt32

from .bounds import boxes_and_radii, normal_cones
from .groups import Int64, batches, previous_use, sizes_of, sorting_order, spans
from .model import MAX_TRIANGLES, MAX_VERTICES, MESHLET, SceneMeshlets, takes_meshlets
from .order import Order, halved_to, order_triangles
from .packing import MOST_IN_RECORD, pack_cones, pack_counts, pack_words

AT_ONCE = 2**18
"""Triangles of a batch. More at once take longer a triangle, since their arrays leave the caches of a processor."""

MOST_INDICES = 2**30
"""Of all meshes with meshlets: their words are then fewer than 2^32."""

KEPT = 0.75
"""A meshlet may be left emptier for the sake of its shape, if it has at least this part of the triangles that fit."""


def build_meshlets(
    scene: Scene, max_vertices: int = MAX_VERTICES, max_triangles: int = MAX_TRIANGLES
) -> SceneMeshlets:
    """Return the meshlets of a scene, of at most so many vertices (3 to 256) and triangles (1 to 256) each.

    Every triangle is kept, with the order of its vertices; duplicate and degenerate ones are, too. Meshes with the same
    indices are cut alike and share their words. With v = min(max_vertices, 255), which is the most that a record can
    count, and g = min(v // 3, max_triangles), a mesh of t triangles has at most t / (0.6 g) + 1 meshlets. The result
    depends on nothing but the arguments.

    Raises:
        SceneError: the meshes have more than 2^30 indices.
        ValueError: a limit is out of its range.
    """
    if not (3 <= max_vertices <= 256 and 1 <= max_triangles <= 256):
        raise ValueError(
            f"a meshlet has 3 to 256 vertices and 1 to 256 triangles, not {max_vertices} and {max_triangles}"
        )
    max_vertices = min(max_vertices, MOST_IN_RECORD)
    meshes, ranges = scene.meshes, np.zeros((len(scene.meshes), 2), np.uint32)
    taking = np.flatnonzero(takes_meshlets(scene, max_vertices, max_triangles))
    if not len(taking):
        none = np.zeros(0, MESHLET), np.zeros(0, np.uint32)
        return SceneMeshlets(*none, ranges, scene.indices, (max_vertices, max_triangles))
    total = int(meshes["index_count"][taking].sum(dtype=np.int64))
    if total > MOST_INDICES:
        raise SceneError(
            f"The meshes of this scene have {total} indices, and meshlets are built for at most {MOST_INDICES}: "
            "split the scene, or draw it with --set geometry=classic."
        )

    # Meshes with the same indices are one shape, for which the vertices of the first such mesh count.
    _, shapes, shape_of = np.unique(meshes["first_index"][taking], return_index=True, return_inverse=True)
    shape_of = shape_of.reshape(-1)
    cut = _cut_shapes(scene, meshes[taking[shapes]], max_vertices, max_triangles)
    counts = np.bincount(cut.shape, minlength=len(shapes))
    first = np.cumsum(counts) - counts
    ranges[taking, 1] = counts[shape_of]
    ranges[taking, 0] = np.cumsum(ranges[taking, 1]) - ranges[taking, 1]
    kept = spans(first[shape_of], counts[shape_of])
    records = np.zeros(len(kept), MESHLET)
    records["first_index"] = cut.first_index[kept]
    records["counts"] = cut.counts[kept]
    records["data"] = cut.data[kept]
    records["mesh"] = np.repeat(taking, counts[shape_of])
    for some in batches(cut.counts[kept] >> 8, AT_ONCE):
        _set_bounds(scene, cut.indices, records[some])
    return SceneMeshlets(records, cut.words, ranges, cut.indices, (max_vertices, max_triangles))


@dataclass(frozen=True)
class _Cut:
    """The meshlets of shapes, sorted by shape: the shape of each and the fields of its record (K,), all words, and the
    permuted indices of the scene."""

    shape: Int64
    first_index: Int64
    counts: UInt32
    data: Int64
    words: UInt32
    indices: UInt32


def _cut_shapes(scene: Scene, shapes: np.ndarray, max_vertices: int, max_triangles: int) -> _Cut:
    """Return the meshlets of shapes, rows of the table of meshes whose ranges of indices do not overlap."""
    counts = shapes["index_count"].astype(np.int64) // 3
    starts = np.cumsum(counts) - counts
    shape = np.repeat(np.arange(len(shapes)), counts)
    # By triangle, the places of its three indices in the pool; the list of them is what is permuted.
    places = (shapes["first_index"].astype(np.int64) - 3 * starts)[shape] + 3 * np.arange(len(shape))
    listed = places.copy()
    pieces = [starts]
    for huge in np.flatnonzero(counts > AT_ONCE):
        some = slice(starts[huge], starts[huge] + counts[huge])
        triangles = _indices(scene.indices, listed[some]) + shapes["first_vertex"][huge]
        huge_order, parts = halved_to(AT_ONCE, scene.positions, triangles)
        listed[some] = listed[some][huge_order]
        pieces.append(starts[huge] + parts[1:])
    piece_starts = np.sort(np.concatenate(pieces))

    indices = scene.indices.copy()
    cuts, sizes, words, data, word_count = [], [], [], [], 0
    for some in batches(sizes_of(piece_starts, len(listed)), AT_ONCE):
        begin = piece_starts[some.start]
        end = len(listed) if some.stop == len(piece_starts) else piece_starts[some.stop]
        own = _indices(scene.indices, listed[begin:end])
        triangles = own + shapes["first_vertex"][shape[begin:end], None]
        order = order_triangles(
            scene.positions, triangles, piece_starts[some] - begin, max_vertices, max_triangles
        )
        cut = _cut(triangles[order.triangles].reshape(-1), order, max_vertices, max_triangles)
        own = own[_in_source_order(order.triangles, cut)]
        indices[places[begin:end, None] + np.arange(3)] = own
        batch_words, first_words, vertex_counts = pack_words(own.reshape(-1), cut)
        cuts.append(begin + cut)
        sizes.append(pack_counts(vertex_counts, sizes_of(cut, len(own))))
        data.append(word_count + first_words)
        words.append(batch_words)
        word_count += len(batch_words)
    first = np.concatenate(cuts)
    return _Cut(
        shape[first],
        3 * (first - starts[shape[first]]),
        np.concatenate(sizes),
        np.concatenate(data),
        np.concatenate(words),
        indices,
    )


def _indices(pool: UInt32, places: Int64) -> UInt32:
    """Return the indices (T, 3) of triangles, by the places of their first ones."""
    return pool[places[:, None] + np.arange(3)]


def _cut(vertices: UInt32, order: Order, max_vertices: int, max_triangles: int) -> Int64:
    """Return (K,) the first triangles of the meshlets of an ordered list of triangles with `vertices` (3 T,).

    All regions are cut side by side: each step finds the next meshlet of each region. It looks at a window of
    `max_triangles`, sums up the vertices that are new in it, and takes the triangles up to the limit of vertices.
    """
    total = len(vertices) // 3
    never = np.full(3 * max_triangles, np.iinfo(np.int32).max, np.int32)  # windows may reach beyond the end
    previous = np.concatenate([previous_use(vertices), never]).reshape(-1, 3)
    windows = np.lib.stride_tricks.sliding_window_view(previous, (max_triangles, 3))[:, 0]
    borders = np.append(order.cells, total)
    place, end = order.regions, np.append(order.regions[1:], total)
    cuts = []
    while len(place):
        cuts.append(place)
        new = windows[place] < (3 * place)[:, None, None]
        fitting = np.cumsum(new.sum(axis=2, dtype=np.int16), axis=1) <= max_vertices
        full = np.minimum(fitting.sum(axis=1), end - place)
        place = place + _taken(place, full, borders)
        place, end = place[place < end], end[place < end]
    return np.sort(np.concatenate(cuts))


def _taken(place: Int64, full: Int64, borders: Int64) -> Int64:
    """Return how many triangles meshlets take that begin at `place`, if at most `full` of them fit.

    The last border of a cell that is in reach ends the meshlet, or else the triangles up to the next border are shared
    evenly among as many meshlets as they need: either only if the meshlet is not much emptier for it.
    """
    last = np.searchsorted(borders, place + full, side="right") - 1
    to_last = borders[last] - place
    to_next = borders[np.minimum(last + 1, len(borders) - 1)] - place
    even = -(-to_next // -(-to_next // full))
    taken = np.where(even >= KEPT * full, even, full)
    return np.where(to_last >= KEPT * full, to_last, taken)


def _in_source_order(triangles: Int64, cuts: Int64) -> Int64:
    """Return the triangles with those of each meshlet in the order of the file, whose author chose it for caches."""
    meshlet = np.empty(len(triangles), np.int64)
    meshlet[triangles] = np.repeat(np.arange(len(cuts)), sizes_of(cuts, len(triangles)))
    return sorting_order(meshlet)


def _set_bounds(scene: Scene, indices: UInt32, records: np.ndarray) -> None:
    """Set what depends on positions: meshes may share indices, but have vertices of their own."""
    rows = scene.meshes[records["mesh"]]
    counts = 3 * (records["counts"].astype(np.int64) >> 8)
    places = spans(rows["first_index"].astype(np.int64) + records["first_index"], counts)
    starts = np.cumsum(counts) - counts
    corners: Float32 = scene.positions[indices[places] + np.repeat(rows["first_vertex"], counts)]
    records["centre"], records["extent"], records["radius"] = boxes_and_radii(corners, starts)
    records["cone"] = pack_cones(*normal_cones(corners.reshape(-1, 3, 3), starts // 3))
