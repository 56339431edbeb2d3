"""The triangles of a mesh in the order in which structures are built, and which of them are left out."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from common.scene import Scene

from .bvh.morton import order


def mesh_triangles(scene: Scene, mesh: int) -> tuple[NDArray[np.uint32], NDArray[np.float32]]:
    """Return the (T, 3) indices of a mesh into its own vertices, and its (V, 3) positions of the rest pose."""
    row = scene.meshes[mesh]
    first, count = int(row["first_index"]), int(row["index_count"])
    vertex, vertices = int(row["first_vertex"]), int(row["vertex_count"])
    return scene.indices[first : first + count].reshape(-1, 3), scene.positions[vertex : vertex + vertices]


def build_order(
    indices: NDArray[np.uint32], positions: NDArray[np.float32], deforms: bool = False
) -> NDArray[np.uint32]:
    """Return the numbers of the triangles that a structure has, in Morton order of their centres.

    A triangle with a corner that is not finite is left out, and so is one without area, unless the mesh `deforms`: then
    it may have an area later.
    """
    corners = positions[indices].astype(np.float64)  # (T, 3, 3)
    kept = np.isfinite(corners).all(axis=(1, 2))
    if not deforms:
        with np.errstate(invalid="ignore"):
            area = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        kept &= (area != 0.0).any(axis=1)
    numbers = np.flatnonzero(kept)
    return numbers[order(corners[numbers].mean(axis=1))].astype(np.uint32)
