"""Levels of detail as meshes: a view of a scene that has the coarser levels of each mesh as further meshes.

The levels are those of `common.mesh.lods`. They use the vertices of their mesh, so a level costs indices alone. Off by
default: proving their errors takes minutes for a large scene.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from common.mesh.lods import FEW_INDICES, MAX_FURTHER_LEVELS, Level, lod_chain
from common.mesh.optimize import meshoptimizer
from common.mesh.pools import mesh_indices, mesh_positions
from common.scene import Float32, Scene, UInt32

from .model import rigid_and_solid

MAX_LEVELS = 1 + MAX_FURTHER_LEVELS


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


def with_levels(scene: Scene) -> SceneLevels:
    """Return the levels of the meshes of a scene. Deforming, blended and small meshes, and cloth, have level 0 alone.

    Distances are the sampled ones of `lod_chain`.

    Raises:
        UserError: the package `meshoptimizer` is not installed.
    """
    meshoptimizer("making levels of detail")
    rows = scene.meshes
    count = len(rows)
    meshes = np.repeat(np.arange(count, dtype=np.uint32)[:, None], MAX_LEVELS, axis=1)
    errors, counts = np.zeros((count, MAX_LEVELS), np.float32), np.ones(count, np.uint32)
    chains: dict[tuple[int, ...], list[tuple[int, Level]]] = {}
    """The coarser levels with their first indices, by the geometry of meshes."""
    added, names, pool, end = [rows], list(scene.mesh_names), [scene.indices], len(scene.indices)
    for mesh in np.flatnonzero(rigid_and_solid(scene) & (rows["index_count"] > FEW_INDICES)).tolist():
        key = tuple(rows[mesh][["first_index", "index_count", "first_vertex"]].tolist())
        if key not in chains:
            levels = lod_chain(scene, mesh, MAX_FURTHER_LEVELS)[1:]
            starts = end + np.cumsum([0, *(len(level.indices) for level in levels)])
            chains[key] = list(zip(starts[:-1].tolist(), levels, strict=True))
            pool += [level.indices for level in levels]
            end = int(starts[-1])
        used = mesh_positions(scene, mesh)[mesh_indices(scene, mesh)]
        extent = float((used.max(axis=0) - used.min(axis=0)).max())
        for number, (first, level) in enumerate(chains[key], 1):
            row = rows[mesh : mesh + 1].copy()
            row["first_index"], row["index_count"] = first, len(level.indices)
            meshes[mesh, number:] = len(names)
            errors[mesh, number:] = max(errors[mesh, number - 1], level.distance * extent)
            counts[mesh] += 1
            added.append(row)
            names.append(f"{scene.mesh_names[mesh]} level {number}")
    view = replace(scene, indices=np.concatenate(pool), meshes=np.concatenate(added), mesh_names=names)
    view.revision, view.bounds, view.origin = scene.revision, scene.bounds, scene.origin
    return SceneLevels(view, meshes, errors, counts)
