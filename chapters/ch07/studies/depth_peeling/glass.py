"""The scene of the study: panes of coloured glass that cross in a common axis, so that no order of them is right."""

from __future__ import annotations

import numpy as np

from common.numerics.transforms import pose_looking_at, rotation
from common.scene import MESH_DTYPE, Instances, Light, Material, Nodes, Scene, SceneCamera

COLORS = ((0.9, 0.1, 0.1), (0.1, 0.7, 0.2), (0.15, 0.3, 0.9), (0.9, 0.7, 0.1))
"""Of the panes, each turned a part of a half circle farther than the one before."""

OPACITY = 0.5


def glass() -> Scene:
    """Return the scene of the study."""
    turns = [rotation((0, 1, 0), np.pi * number / len(COLORS)) for number in range(len(COLORS))]
    return panes_on_floor(np.stack(turns), np.array([(*color, OPACITY) for color in COLORS]))


def panes_on_floor(turns: np.ndarray, colors: np.ndarray) -> Scene:
    """Return panes with (N, 4, 4) matrices and (N, 4) colours above a floor.

    All are squares from -1 to 1 that face +z before they are placed.
    """
    materials = [
        Material(f"glass {number}", tuple(color), alpha_mode="blend", unlit=True, double_sided=True)
        for number, color in enumerate(colors.tolist())
    ]
    materials.append(Material("floor", (0.6, 0.6, 0.58, 1.0), 0.0, 0.9, double_sided=True))
    floor = rotation((1, 0, 0), -np.pi / 2) @ np.diag((3.0, 3.0, 1.0, 1.0))
    floor[1, 3] = -1.05
    camera, sun = pose_looking_at((1.0, 1.4, 3.6), (0.0, -0.1, 0.0)), rotation((1, 0.4, 0), -0.9)
    nodes = np.stack([*turns, floor, camera, sun])
    meshes = np.zeros(len(materials), MESH_DTYPE)
    meshes["index_count"], meshes["vertex_count"], meshes["material"] = 6, 4, np.arange(len(materials))
    meshes["bounds_min"], meshes["bounds_max"] = (-1, -1, 0), (1, 1, 0)
    numbers = np.arange(len(materials), dtype=np.int32)
    return Scene(
        name="crossing glass",
        path=None,
        positions=np.array([(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)], np.float32),
        normals=np.tile(np.array((0, 0, 1), np.float32), (4, 1)),
        tangents=np.tile(np.array((1, 0, 0, 1), np.float32), (4, 1)),
        uv0=np.zeros((4, 2), np.float32),
        uv1=None,
        colors=None,
        indices=np.array([0, 1, 2, 0, 2, 3], np.uint32),
        meshes=meshes,
        mesh_names=[material.name for material in materials],
        materials=materials,
        images=[],
        nodes=Nodes(
            parent=np.full(len(nodes), -1, np.int32),
            translation=np.zeros((len(nodes), 3)),
            rotation=np.tile((0.0, 0.0, 0.0, 1.0), (len(nodes), 1)),
            scale=np.ones((len(nodes), 3)),
            matrix=nodes,
            has_matrix=np.ones(len(nodes), bool),
            names=[*(material.name for material in materials), "camera", "sun"],
        ),
        instances=Instances(numbers, numbers.copy()),
        lights=[Light("directional", len(nodes) - 1, "sun", (1.0, 0.95, 0.85), 20_000.0)],
        cameras=[SceneCamera("front", len(nodes) - 2, yfov=np.radians(45.0), ev100=13.0)],
        animations=[],
        deformations=[],
    )
