"""Meshes put in the order that a GPU likes: equal vertices once, triangles by locality, vertices by first use.

Four passes, each of which relies on those before it. *remap* makes vertices that are equal in every bit one.
*cache* orders triangles so that a vertex is used again while its result is still there. *overdraw* then moves
clusters of triangles so that the outer ones come first and hide the others. *fetch* numbers vertices in the order
of their first use, so that memory is read from front to back. No pass changes what is drawn.
"""

from __future__ import annotations

from collections.abc import Iterable
from types import ModuleType
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from common.errors import UserError
from common.mesh.metrics import cache_use
from common.mesh.pools import gathered, rebuilt, take_vertices, vertex_words
from common.names import suggest
from common.scene import Float32, Scene, UInt32

Pass = Literal["remap", "cache", "overdraw", "fetch"]
PASSES: tuple[Pass, ...] = get_args(Pass)
OVERDRAW_THRESHOLD = 1.05
"""The overdraw pass may make the cache this many times worse (the package's own advice)."""


def meshoptimizer(use: str) -> ModuleType:
    """Return the package `meshoptimizer`; `use` begins the sentence of the error where it is not installed.

    Raises:
        UserError: the package is not installed.
    """
    try:
        import meshoptimizer as module
    except ImportError:
        raise UserError(
            f"{use} needs the package meshoptimizer, which a C++ compiler builds from source: "
            "run `pip install meshoptimizer==0.2.30a0`"
        ) from None
    package: ModuleType = module
    return package


def optimized(scene: Scene, passes: Iterable[Pass] = PASSES, unused_tangents: bool = True) -> Scene:
    """Return the scene with its meshes in a better order; numbers of meshes and instances stay what they are.

    `passes` are done in the order of `PASSES`. *remap* and *fetch* also drop vertices that no triangle uses, and a
    mesh whose cache misses would grow keeps the order of its triangles. What is deformed counts its joints, weights
    and morph targets among what makes vertices equal; meshes with normals of their triangles stay as they are, since
    posing relies on their order (`Deformation.flat`). Some exporters write tangents for each triangle even where no
    normal map needs them, and then nearly no vertices are equal; without `unused_tangents` the direction of tangents
    counts only where a material has a normal map, and a vertex keeps that of the first of its equals.

    Raises:
        UserError: a pass has no such name, or needs the package `meshoptimizer` and it is not installed.
    """
    chosen = set(passes)
    for name in chosen - set(PASSES):
        raise UserError(f"there is no pass {name!r} over meshes{suggest(name, PASSES)}")
    library = (
        meshoptimizer("ordering triangles (cache, overdraw)") if chosen & {"cache", "overdraw"} else None
    )
    mapped = np.array([material.normal_texture is not None for material in scene.materials], bool)
    meshes = scene.meshes.copy()
    deformations = list(scene.deformations)
    sources: list[NDArray[np.intp]] = []
    pool: list[UInt32] = []
    vertex_count = index_count = 0
    blocks, block_of = np.unique(
        np.stack([meshes["first_vertex"], meshes["vertex_count"]], axis=1), axis=0, return_inverse=True
    )
    for block, (first, count) in enumerate(blocks.tolist()):
        members = np.flatnonzero(block_of.reshape(-1) == block)
        ranges, range_of = np.unique(
            np.stack([meshes["first_index"][members], meshes["index_count"][members]], axis=1),
            axis=0,
            return_inverse=True,
        )
        streams = [scene.indices[start : start + length] for start, length in ranges.tolist()]
        deforming = [place for place, each in enumerate(deformations) if each.mesh in members]
        source = np.arange(count)
        if not any(deformations[place].flat for place in deforming):
            if "remap" in chosen:
                tangents = unused_tangents or bool(mapped[meshes["material"][members]].any())
                words = vertex_words(
                    scene, first, count, [scene.deformations[place] for place in deforming], tangents
                )
                source, streams = remapped(words, streams)
            if library is not None:
                positions = scene.positions[first + source]
                streams = [_ordered(library, stream, positions, chosen) for stream in streams]
            if "fetch" in chosen:
                order, streams = in_fetch_order(streams)
                source = source[order]
        for place in deforming:
            deformations[place] = take_vertices(deformations[place], source)
        starts = index_count + np.cumsum([0, *map(len, streams)])
        meshes["first_index"][members] = starts[:-1][range_of.reshape(-1)]
        meshes["first_vertex"][members] = vertex_count
        meshes["vertex_count"][members] = len(source)
        sources.append(first + source)
        pool += streams
        vertex_count += len(source)
        index_count = int(starts[-1])
    return rebuilt(
        scene,
        gathered(scene, np.concatenate([np.zeros(0, np.intp), *sources])),
        np.concatenate([np.zeros(0, np.uint32), *pool]),
        meshes,
        list(scene.mesh_names),
        deformations,
    )


def remapped(words: UInt32, streams: list[UInt32]) -> tuple[NDArray[np.intp], list[UInt32]]:
    """Return which rows of `words` (V, W) to keep, and index streams that use those instead of their equals.

    Of equal vertices the first that is used stays, and the order of those that stay does too. Equal means equal
    bits: 0.0 and -0.0 differ, and so do NaNs with different payloads.
    """
    used = np.unique(np.concatenate([np.zeros(0, np.uint32), *streams]))
    rows = np.ascontiguousarray(words[used])
    keys = rows.view(np.dtype((np.void, rows.itemsize * rows.shape[1]))).reshape(-1)
    _, first, inverse = np.unique(keys, return_index=True, return_inverse=True)
    order = np.argsort(first)
    rank = np.empty(len(order), np.uint32)
    rank[order] = np.arange(len(order), dtype=np.uint32)
    new = np.zeros(len(words), np.uint32)
    new[used] = rank[inverse.reshape(-1)]
    return used[first[order]].astype(np.intp), [new[stream] for stream in streams]


def in_fetch_order(streams: list[UInt32]) -> tuple[NDArray[np.intp], list[UInt32]]:
    """Return the used vertices in the order of their first use, and the streams numbered by it."""
    together = np.concatenate([np.zeros(0, np.uint32), *streams])
    used, first, inverse = np.unique(together, return_index=True, return_inverse=True)
    order = np.argsort(first)
    rank = np.empty(len(order), np.uint32)
    rank[order] = np.arange(len(order), dtype=np.uint32)
    renumbered = rank[inverse.reshape(-1)]
    return used[order].astype(np.intp), np.split(renumbered, np.cumsum([len(s) for s in streams])[:-1])


def _ordered(library: ModuleType, indices: UInt32, positions: Float32, chosen: set[Pass]) -> UInt32:
    """Return the triangles of `indices` in the order of the passes, or as they are if the cache would lose by it."""
    if len(indices) == 0:
        return indices
    before = cache_use(indices).misses
    best = indices
    if "cache" in chosen:
        ordered = cache_order(library, indices, len(positions))
        if cache_use(ordered).misses <= before:
            best = ordered
    if "overdraw" in chosen:
        ordered = np.empty_like(best)
        library.optimize_overdraw(ordered, best, positions, threshold=OVERDRAW_THRESHOLD)
        if cache_use(ordered).misses <= before:
            best = ordered
    return best


def cache_order(library: ModuleType, indices: UInt32, vertex_count: int) -> UInt32:
    """Return the triangles of `indices` (3 T,), all below `vertex_count`, ordered for the vertex cache."""
    ordered = np.empty(len(indices), np.uint32)
    library.optimize_vertex_cache(ordered, np.ascontiguousarray(indices), vertex_count=vertex_count)
    return ordered
