"""Levels of detail: fewer and fewer triangles over the same vertices, each level within a stated distance of the mesh.

The work is done by the package `meshoptimizer`: edges are collapsed in the order of the error that quadrics of the
planes around estimate (Garland and Heckbert 1997, "Surface Simplification Using Quadric Error Metrics"). A quadric
error is an average, and surfaces within 0.02 by it were found 0.045 apart, and 0.13 where a small part had vanished.
So every level is measured.
"""

from __future__ import annotations

from dataclasses import dataclass
from types import ModuleType

import numpy as np

from common.mesh.metrics import hausdorff, surely_within
from common.mesh.optimize import cache_order, meshoptimizer, remapped
from common.mesh.pools import mesh_indices, mesh_positions, vertex_words
from common.scene import Float32, Scene, UInt32

MAX_DISTANCE = 0.02
"""Of the extent: at most this far are levels that preserve topology from the mesh."""
MAX_FURTHER_LEVELS = 7
FEW_INDICES = 1024
"""A level with at most so many indices is not simplified any further: a draw costs more than its triangles."""
_LEAST_GAIN = 1.1
_STEP_BACK = 0.8
_ATTEMPTS = 4
_SLOPPY_ERROR = 0.1


@dataclass(frozen=True)
class Level:
    """One level of detail; lengths are fractions of the extent, the longest side of the mesh's box."""

    indices: UInt32  # (3 T,), of the mesh's own vertices
    error: float  # estimated by the simplifier
    distance: float  # sampled Hausdorff distance to level 0, both ways
    sloppy: bool = False  # does not preserve topology: parts may merge and holes close


def simplified(scene: Scene, mesh: int, ratio: float = 0.2, error: float = 1e-2) -> tuple[UInt32, float]:
    """Return indices (3 T,) of about `ratio` times as many triangles of the mesh's own vertices, and the error reached.

    The result has at most `ratio` times as many indices, or is as small as it can be without going beyond `error`
    (a fraction of the extent, as estimated by quadrics) and without changing the topology. Vertices at one place with
    different attributes are a seam, along which both sides collapse together; see `lod_chain` for tangents.

    Raises:
        UserError: the package `meshoptimizer` is not installed.
        ValueError: a ratio outside 0..1.
    """
    if not 0 <= ratio <= 1:
        raise ValueError(f"a ratio is in 0..1, not {ratio}")
    source = _without_tangents(scene, mesh)
    target = int(len(source) * ratio)
    return _simplify(meshoptimizer("simplifying a mesh"), mesh_positions(scene, mesh), source, target, error)


def lod_chain(
    scene: Scene,
    mesh: int,
    further: int = MAX_FURTHER_LEVELS - 1,
    distance: float = MAX_DISTANCE,
    samples: int = 1000,
    seed: int = 0,
) -> list[Level]:
    """Return level 0, the mesh itself, and at most `further` levels that each aim at half of the one before.

    The default of 6 is what a record of `common.mesh.file` has room for. Every level is made from the mesh, not from
    the level before, so errors do not add up, and is kept only if it provably is at most `distance` away from it
    everywhere (`surely_within`; `samples` only serve to report the distance). Where that leaves less than a tenth to
    be gained, a sloppy level is tried, which ignores topology and the bound and says so. A mesh of 1,024 indices or
    fewer has level 0 alone. The rest pose counts; the scene stays as it is. Nearly all the
    time goes into the proofs: 10 to 40 s for 20,000 triangles.

    Corners that differ in nothing but the direction of their tangents are simplified as one vertex: some exporters
    give each triangle tangents of its own, and then every edge would be a seam that nothing may collapse.

    Raises:
        UserError: the package `meshoptimizer` is not installed.
        ValueError: `further` is not in 0..7.
    """
    if not 0 <= further <= MAX_FURTHER_LEVELS:
        raise ValueError(f"a chain has 0 to {MAX_FURTHER_LEVELS} further levels, not {further}")
    library = meshoptimizer("making levels of detail")
    positions, original = mesh_positions(scene, mesh), mesh_indices(scene, mesh)
    levels = [Level(original.copy(), 0.0, 0.0)]
    source = _without_tangents(scene, mesh)
    drawn = positions[original]
    extent = float((drawn.max(axis=0) - drawn.min(axis=0)).max()) if len(drawn) else 0.0

    def measured(indices: UInt32, error: float, sloppy: bool) -> Level:
        apart = hausdorff(positions, original, positions, indices, samples, seed) / (extent or 1.0)
        return Level(cache_order(library, indices, len(positions)), error, apart, sloppy)

    def surely(level: Level) -> bool:
        pairs = ((original, level.indices), (level.indices, original))
        return level.distance <= distance and all(
            surely_within(positions, a, positions, b, distance * extent) for a, b in pairs
        )

    while len(levels) <= further and (count := len(levels[-1].indices)) > FEW_INDICES:
        limit, chosen = distance, None
        for _ in range(_ATTEMPTS):
            indices, error = _simplify(library, positions, source, count // 2, limit)
            if len(indices) * _LEAST_GAIN > count:
                break
            level = measured(indices, error, sloppy=False)
            if surely(level):
                chosen = level
                break
            limit = _STEP_BACK * min(limit, error) * distance / max(level.distance, distance)
        if chosen is None and len(levels) > 1:
            indices, error = _simplify(library, positions, source, count // 2, _SLOPPY_ERROR, sloppy=True)
            if 0 < len(indices) < count:
                chosen = measured(indices, error, sloppy=True)
        if chosen is None:
            break
        levels.append(chosen)
    return levels


def _without_tangents(scene: Scene, mesh: int) -> UInt32:
    """Return the indices of a mesh with one vertex for all that differ in nothing but their tangents' directions."""
    row = scene.meshes[mesh]
    deforming = [each for each in scene.deformations if each.mesh == mesh]
    first, count = int(row["first_vertex"]), int(row["vertex_count"])
    words = vertex_words(scene, first, count, deforming, tangents=False)
    kept, (stream,) = remapped(words, [mesh_indices(scene, mesh)])
    return kept.astype(np.uint32)[stream]


def _simplify(
    library: ModuleType, positions: Float32, indices: UInt32, target: int, error: float, sloppy: bool = False
) -> tuple[UInt32, float]:
    if len(indices) == 0:
        return indices.copy(), 0.0
    # Vertices that no triangle uses would count: in the extent, and as other sides of seams, which cannot collapse.
    used, own = np.unique(indices, return_inverse=True)
    result, reached = np.empty(len(indices), np.uint32), np.zeros(1, np.float32)
    count = (library.simplify_sloppy if sloppy else library.simplify)(
        result,
        own.reshape(-1).astype(np.uint32),
        positions[used],
        target_index_count=target // 3 * 3,
        target_error=error,
        result_error=reached,
    )
    return used[result[:count]], float(reached[0])
