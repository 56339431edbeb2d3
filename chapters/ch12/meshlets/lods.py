"""Levels of detail as meshes: a view of a scene that has the coarser levels of each mesh as further meshes.

The levels are those of `common.mesh.lods`. They use the vertices of their mesh, so a level costs indices alone, and the
bounds of the mesh are bounds of its levels. Off by default: making levels takes minutes for a large scene.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from common.mesh.lods import FEW_INDICES, MAX_FURTHER_LEVELS
from common.mesh.pools import mesh_indices, mesh_positions
from common.reports import waiting
from common.scene import Float32, Scene, UInt32

from .chains import Chain, kept_chains
from .model import may_be_cut

MAX_LEVELS = 1 + MAX_FURTHER_LEVELS

SURE = 2.0
"""How many times its sampled distance a level may be from its mesh."""


@dataclass(frozen=True, eq=False)
class SceneLevels:
    """The levels of the M meshes of a scene, and `scene`, the view that has them.

    `meshes` (M, 8) uint32 are the meshes of the view by level, the last one repeated, and `counts` (M,) uint32 their
    numbers. `errors` (M, 8) float32 are distances from level 0 in units of the object space, never less than those of
    finer levels.
    """

    scene: Scene
    meshes: UInt32
    errors: Float32
    counts: UInt32

    @property
    def coarser(self) -> bool:
        """Whether any mesh has a level besides itself."""
        return bool((self.counts > 1).any())


def with_levels(scene: Scene, kept: bool = True) -> SceneLevels:
    """Return the levels of the meshes of a scene. Deforming, blended and small meshes, and cloth, have level 0 alone.

    The sampled distances of `lod_chain` are lower bounds. With many more samples, 113 levels of the scenes `city` and
    `atrium` were up to 1.76 times as far from their meshes, so `errors` are twice the sampled ones. The indices of
    levels lie behind those of their mesh, so that a page of geometry that holds the mesh has room for them as well; a
    level on the next page is not drawn (`culling/lists.py`). Levels are kept in the user's cache if `kept`.

    Raises:
        UserError: levels are not in the cache, and the package `meshoptimizer` is not installed.
    """
    rows, count = scene.meshes, len(scene.meshes)
    having = np.flatnonzero(may_be_cut(scene) & (rows["index_count"] > FEW_INDICES)).tolist()
    keys = {
        mesh: tuple(rows[mesh][["first_index", "index_count", "first_vertex"]].tolist()) for mesh in having
    }
    once = {key: mesh for mesh, key in reversed(keys.items())}  # meshes of equal geometry have one chain
    with waiting.told(lambda: f"making levels of detail of {len(once):,} meshes"):
        chains = dict(zip(once, kept_chains(scene, [*once.values()], kept), strict=True))
    meshes = np.repeat(np.arange(count, dtype=np.uint32)[:, None], MAX_LEVELS, axis=1)
    errors, counts = np.zeros((count, MAX_LEVELS), np.float32), np.ones(count, np.uint32)
    pool, shifted, places = _inserted(scene, once, chains)
    moved = rows.copy()
    moved["first_index"] = shifted
    added, names = [moved], list(scene.mesh_names)
    for mesh, key in keys.items():
        used = mesh_positions(scene, mesh)[mesh_indices(scene, mesh)]
        extent = float((used.max(axis=0) - used.min(axis=0)).max())
        first = places[key]
        for number, (indices, distance) in enumerate(chains[key], 1):
            row = rows[mesh : mesh + 1].copy()
            row["first_index"], row["index_count"] = first, len(indices)
            first += len(indices)
            meshes[mesh, number:] = len(names)
            errors[mesh, number:] = max(errors[mesh, number - 1], SURE * distance * extent)
            counts[mesh] += 1
            added.append(row)
            names.append(f"{scene.mesh_names[mesh]} level {number}")
    view = replace(scene, indices=pool, meshes=np.concatenate(added), mesh_names=names)
    view.revision, view.bounds, view.origin = scene.revision, scene.bounds, scene.origin
    return SceneLevels(view, meshes, errors, counts)


_Key = tuple[int, ...]


def _inserted(
    scene: Scene, once: dict[_Key, int], chains: dict[_Key, Chain]
) -> tuple[UInt32, NDArray[np.int64], dict[_Key, int]]:
    """Return the scene's indices with those of levels, where each mesh begins in them, and each chain by its key.

    A chain is inserted where the range of its mesh ends, or of ranges that overlap with it.
    """
    starts = scene.meshes["first_index"].astype(np.int64)
    ends = starts + scene.meshes["index_count"]
    order = np.argsort(starts, kind="stable")
    reached = np.maximum.accumulate(ends[order])
    last = np.ones(len(starts), bool)  # of the ranges that overlap with one another
    last[:-1] = starts[order][1:] >= reached[:-1]
    cuts = reached[last]
    where = cuts[np.searchsorted(cuts, [ends[mesh] for mesh in once.values()])]
    sizes = np.array([sum(len(indices) for indices, _ in chains[key]) for key in once], np.int64)
    parts = [indices for key in once for indices, _ in chains[key]]
    new = np.concatenate(parts) if parts else np.zeros(0, np.uint32)
    pool = np.insert(scene.indices, np.repeat(where, sizes), new)
    by_place = np.argsort(where, kind="stable")
    before = np.r_[0, np.cumsum(sizes[by_place])]
    shifted = starts + before[np.searchsorted(where[by_place], starts, side="right")]
    keys = [*once]
    places = {keys[chain]: int(where[chain] + before[at]) for at, chain in enumerate(by_place.tolist())}
    return pool, shifted, places
