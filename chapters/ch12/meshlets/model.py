"""What meshlets are: their limits, their record on the GPU, and which meshes have them.

A meshlet is a group of triangles that lie close together and use few vertices. The triangles of a mesh are permuted, so
that each of its meshlets is one contiguous range of the mesh's indices. The whole mesh is still the range of all of its
indices, and the order of a triangle's three vertices stays, so flat normals, winding and tangents stay as well.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from common.scene import Scene, UInt32

from ..cloth.fields import properties
from ..scene.pages import PAGE_BYTES
from .groups import group_starts, sorting_order, spans

MAX_VERTICES = 64
MAX_TRIANGLES = 124
"""The usual limits of mesh shaders: 124 triangles are 93 words of local indices, and leave room for the counts."""

MESHLET = np.dtype(
    [
        ("centre", np.float32, 3),  # middle of the box, in object space
        ("radius", np.float32),  # of a sphere around the centre that holds every vertex, rounded up
        ("extent", np.float32, 3),  # half edges of the box, rounded up
        ("cone", np.uint32),  # of the normals: x, y, z, cutoff as signed bytes, see packing.pack_cones
        ("first_index", np.uint32),  # relative to the mesh's first index
        ("counts", np.uint32),  # vertices | triangles << 8
        ("data", np.uint32),  # first word of its vertices and local indices, see packing.pack_words
        ("mesh", np.uint32),
    ]
)
"""48 bytes, the layout of std430."""

_BLENDED = "blend"


@dataclass(frozen=True, eq=False)
class SceneMeshlets:
    """The meshlets of a scene.

    `records` (K,) MESHLET are sorted by mesh, and `words` (W,) uint32 hold their data. `ranges` (M, 2) uint32 are the
    first record and the number of records by mesh; a mesh with 0 records takes the classic path. `indices` (N,) uint32
    are the scene's, with the triangles of each mesh that has meshlets in the order of these. `limits` are the most
    vertices and triangles of a meshlet.
    """

    records: np.ndarray
    words: UInt32
    ranges: UInt32
    indices: UInt32
    limits: tuple[int, int] = (MAX_VERTICES, MAX_TRIANGLES)


def takes_meshlets(
    scene: Scene, max_vertices: int = MAX_VERTICES, max_triangles: int = MAX_TRIANGLES
) -> NDArray[np.bool_]:
    """Return (M,) whether a mesh of the scene is cut into meshlets. The others take the classic path:

    - meshes that are too large to be drawn, which is said when they are uploaded;
    - meshes that deform, and meshes of cloth, since the bounds of their meshlets would change in every frame;
    - meshes of blended materials, whose triangles are drawn in the order of the file;
    - meshes that fit into one meshlet, and those without triangles;
    - meshes that share indices with one of those, or a part of their indices with any other mesh.
    """
    taking = may_be_cut(scene) & ~_fits_one(scene, max_vertices, max_triangles)
    return taking & _may_be_permuted(scene, taking)


def may_be_cut(scene: Scene) -> NDArray[np.bool_]:
    """Return (M,) whether a mesh fits a page of geometry, and neither deforms, nor is cloth, nor is blended."""
    blended = np.array([material.alpha_mode == _BLENDED for material in scene.materials], bool)
    solid = ~blended[scene.meshes["material"]] if len(scene.meshes) else np.zeros(0, bool)
    solid[[deformation.mesh for deformation in scene.deformations]] = False
    cloths = list(properties(scene.nodes, "cloth"))
    solid[scene.instances.mesh[np.isin(scene.instances.node, cloths)]] = False
    fits: NDArray[np.bool_] = scene.meshes["index_count"] <= PAGE_BYTES // 4
    return solid & fits


def _fits_one(scene: Scene, max_vertices: int, max_triangles: int) -> NDArray[np.bool_]:
    """Return (M,) whether one meshlet has room for all of a mesh."""
    meshes = scene.meshes
    few = meshes["index_count"] <= 3 * max_triangles
    fits = few & (np.minimum(meshes["vertex_count"], meshes["index_count"]) <= max_vertices)
    unsure = np.flatnonzero(few & ~fits)  # they may have vertices that no triangle uses
    counts = meshes["index_count"][unsure]
    used = scene.indices[spans(meshes["first_index"][unsure], counts)].astype(np.int64)
    key = np.repeat(unsure, counts) << 32 | used
    key = key[sorting_order(used, key >> 32)]
    distinct = key[group_starts(key)] >> 32
    fits[unsure] = np.bincount(distinct, minlength=len(meshes))[unsure] <= max_vertices
    return fits


def _may_be_permuted(scene: Scene, taking: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return (M,) whether the indices of a mesh belong to meshes that take meshlets, and to all of these as a whole."""
    first = scene.meshes["first_index"].astype(np.int64)
    end = first + scene.meshes["index_count"]
    used = np.flatnonzero(end > first)
    (starts, ends), of = np.unique(np.stack([first[used], end[used]]), axis=1, return_inverse=True)
    of = of.reshape(-1)
    alone = np.ones(len(starts), bool)
    alone[1:] &= starts[1:] >= np.maximum.accumulate(ends)[:-1]
    alone[:-1] &= ends[:-1] <= starts[1:]
    np.logical_and.at(alone, of, taking[used])
    may = np.zeros(len(first), bool)
    may[used] = alone[of]
    return may
