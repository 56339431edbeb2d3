"""Scenes rebuilt with other meshes: vertices gathered into new pools, everything else copied, the source untouched."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from common.scene import Deformation, Float32, Instances, Nodes, Scene, UInt32
from common.scene.parts import changed, kept_nodes

ATTRIBUTES = ("positions", "normals", "tangents", "uv0", "uv1", "colors")
"""Arrays of `Scene` with one row per vertex; `uv1` and `colors` may be None."""
_OF_VERTICES = ("vertex_joints", "vertex_weights")
_OF_TARGETS = ("morph_positions", "morph_normals", "morph_tangents")


def mesh_indices(scene: Scene, mesh: int) -> UInt32:
    """Return the indices (3 T,) of a mesh, relative to its first vertex; a view of the pool."""
    row = scene.meshes[mesh]
    first = int(row["first_index"])
    return scene.indices[first : first + int(row["index_count"])]


def mesh_positions(scene: Scene, mesh: int) -> Float32:
    """Return the rest positions (V, 3) of the vertices of a mesh; a view of the pool."""
    row = scene.meshes[mesh]
    first = int(row["first_vertex"])
    return scene.positions[first : first + int(row["vertex_count"])]


def mesh_bounds(scene: Scene) -> Float32:
    """Return (M, 2, 3) the corners of the box round the vertices that the triangles of each mesh use, in object space.

    A mesh without triangles has a box of zeros.
    """
    counts = scene.meshes["index_count"].astype(np.int64)
    boxes = np.zeros((len(counts), 2, 3), np.float32)
    drawn = np.flatnonzero(counts)
    if len(drawn) == 0:
        return boxes
    # One gather for all meshes: entry k of mesh m stands at its place in the pool of indices.
    starts = np.cumsum(counts[drawn]) - counts[drawn]
    first_index = scene.meshes["first_index"][drawn].astype(np.int64)
    places = np.arange(counts.sum()) + np.repeat(first_index - starts, counts[drawn])
    vertices = scene.indices[places] + np.repeat(
        scene.meshes["first_vertex"][drawn].astype(np.int64), counts[drawn]
    )
    positions = scene.positions[vertices]
    boxes[drawn, 0] = np.minimum.reduceat(positions, starts)
    boxes[drawn, 1] = np.maximum.reduceat(positions, starts)
    return boxes


def vertex_words(
    scene: Scene,
    first: int,
    count: int,
    deformations: Sequence[Deformation] = (),
    tangents: bool = True,
) -> UInt32:
    """Return (V, W) all that is known of `count` vertices from `first` on, as words: equal rows are equal vertices.

    `deformations` are those of meshes that use exactly these vertices; joints, weights and morph targets count too.
    Without `tangents` only their handedness does.
    """
    parts: list[NDArray[Any]] = []
    for name in ATTRIBUTES:
        values = getattr(scene, name)
        if values is not None:
            part = values[first : first + count]
            parts.append(part[:, 3:] if name == "tangents" and not tangents else part)
    for deformation in deformations:
        parts += [values for name in _OF_VERTICES if (values := getattr(deformation, name)) is not None]
        for name in _OF_TARGETS:
            if (targets := getattr(deformation, name)) is not None:
                parts += list(targets)
    return np.concatenate([np.ascontiguousarray(part).view(np.uint32) for part in parts], axis=1)


def take_vertices(deformation: Deformation, source: NDArray[np.intp]) -> Deformation:
    """Return the deformation of a mesh whose vertex i copies vertex `source[i]` of the old one."""
    taken: dict[str, Any] = {}
    for name in _OF_VERTICES:
        if (values := getattr(deformation, name)) is not None:
            taken[name] = values[source]
    for name in _OF_TARGETS:
        if (values := getattr(deformation, name)) is not None:
            taken[name] = values[:, source]
    return replace(deformation, **taken)


def rebuilt(
    scene: Scene,
    attributes: dict[str, Float32 | None],
    indices: UInt32,
    meshes: np.ndarray,
    names: list[str],
    deformations: list[Deformation],
    nodes: Nodes | None = None,
    instances: Instances | None = None,
) -> Scene:
    """Return a scene with other geometry; nodes and instances are those of `scene` unless given.

    What `edit()` changes is copied, so that the two scenes share nothing that either may write to; images and
    animations are read-only and shared.
    """
    drawn = scene.instances
    if instances is None:
        local = None if drawn.local is None else drawn.local.copy()
        instances = Instances(drawn.node.copy(), drawn.mesh.copy(), local, drawn.visible.copy())
    return changed(
        scene,
        **attributes,
        indices=indices,
        meshes=meshes,
        mesh_names=names,
        deformations=deformations,
        nodes=kept_nodes(scene.nodes, np.ones(len(scene.nodes), bool)) if nodes is None else nodes,
        instances=instances,
        lights=list(scene.lights),
    )


def gathered(scene: Scene, source: NDArray[np.intp]) -> dict[str, Float32 | None]:
    """Return the vertex arrays of a scene whose vertex i copies vertex `source[i]` of the pool, bit by bit."""
    return {name: None if (values := getattr(scene, name)) is None else values[source] for name in ATTRIBUTES}
