"""Scenes of cloth made to grow, built in memory: sheets that hang from their upper edge, and what is in their way.

Nodes say what is cloth as glTF files do, by `extras.strata.cloth` and `extras.strata.collider`.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from common.scene import MESH_DTYPE, Instances, Light, Material, Nodes, Scene

SHEET = {
    "kg_per_m2": 0.2,
    "stretch_n_per_m": 400,
    "shear_n_per_m": 60,
    "bend_n_per_m": 4,
    "damping_per_s": 1.5,
}


def sheet(columns: int, rows: int, width: float = 1.0, height: float = 1.0) -> tuple[np.ndarray, np.ndarray]:
    """Return the vertices (V, 3) of an upright sheet below the origin, row by row, and its triangles (T, 3)."""
    v, u = np.meshgrid(np.linspace(0, 1, rows), np.linspace(0, 1, columns), indexing="ij")
    points = np.stack([(u - 0.5) * width, -v * height, 0 * u], -1).reshape(-1, 3)
    at = np.arange(rows * columns).reshape(rows, columns)
    a, b, c, d = (at[:-1, :-1], at[:-1, 1:], at[1:, :-1], at[1:, 1:])
    triangles = np.stack([a, c, d, a, d, b], -1).reshape(-1, 3)
    return points.astype(np.float32), triangles.astype(np.uint32)


def cloth(
    columns: int = 5, rows: int = 5, pins: Sequence[int] | None = None, **fields: Any
) -> dict[str, Any]:
    """Return the property of a sheet; without `pins` its upper edge is held."""
    held = list(range(columns)) if pins is None else list(pins)
    return SHEET | {"columns": columns, "rows": rows, "pins": held} | fields


def cloth_scene_of(
    *pieces: dict[str, Any],
    matrices: Sequence[np.ndarray] = (),
    colliders: Sequence[tuple[dict[str, Any], np.ndarray]] = (),
    size: tuple[int, int] = (5, 5),
    material: Material | None = None,
    light: bool = True,
) -> Scene:
    """Return a scene in which node i draws a sheet of `size` and says `pieces[i]` of it; colliders have no mesh.

    All sheets share the vertices and the mesh.
    """
    points, triangles = sheet(*size)
    count, all_of = len(pieces), len(pieces) + len(colliders)
    places = [*matrices, *(np.eye(4) for _ in range(count - len(matrices))), *(at for _, at in colliders)]
    meshes = np.zeros(1, MESH_DTYPE)
    meshes["index_count"], meshes["vertex_count"] = triangles.size, len(points)
    meshes["bounds_min"], meshes["bounds_max"] = points.min(axis=0), points.max(axis=0)
    extras = {node: {"strata": {"cloth": said}} for node, said in enumerate(pieces) if said}
    extras |= {count + k: {"strata": {"collider": said}} for k, (said, _) in enumerate(colliders)}
    lights = [Light("directional", node=all_of, intensity=3.0)] if light else []
    nodes = Nodes(
        parent=np.full(all_of + 1, -1, np.int32),
        translation=np.zeros((all_of + 1, 3)),
        rotation=np.tile((0.0, 0.0, 0.0, 1.0), (all_of + 1, 1)),
        scale=np.ones((all_of + 1, 3)),
        matrix=np.array([*places, np.eye(4)], np.float64).reshape(-1, 4, 4),
        has_matrix=np.ones(all_of + 1, bool),
        names=[f"sheet {k}" for k in range(count)] + [f"stone {k}" for k in range(len(colliders))] + ["sun"],
        extras=extras,
    )
    normals = np.tile(np.array((0, 0, 1), np.float32), (len(points), 1))
    return Scene(
        name="cloth",
        path=None,
        positions=points,
        normals=normals,
        tangents=np.tile(np.array((1, 0, 0, 1), np.float32), (len(points), 1)),
        uv0=np.stack([points[:, 0] + 0.5, -points[:, 1]], -1).astype(np.float32),
        uv1=None,
        colors=None,
        indices=triangles.reshape(-1),
        meshes=meshes,
        mesh_names=["sheet"],
        materials=[material or Material(metallic=0.0, double_sided=True)],
        images=[],
        nodes=nodes,
        instances=Instances(np.arange(count, dtype=np.int32), np.zeros(count, np.int32)),
        lights=lights,
        cameras=[],
        animations=[],
        deformations=[],
    )
