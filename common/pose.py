"""The scene at one time: animation sampled, node matrices composed, deforming meshes posed; float64 numpy."""

from __future__ import annotations

import numpy as np

from common.scene import Float64, Pose, Scene
from common.transforms import compose


def evaluate_pose(scene: Scene, time: float) -> Pose:
    """Return where every node, instance and deforming vertex of a scene is at `time` (seconds)."""
    nodes = scene.nodes
    local = compose(nodes.translation, nodes.rotation, nodes.scale)
    local[nodes.has_matrix] = nodes.matrix[nodes.has_matrix]
    world = compose_levels(scene, local)
    world_from_object = world[scene.instances.node]
    if scene.instances.local is not None:
        world_from_object = world_from_object @ scene.instances.local
    return Pose(time, world, world_from_object, {})


def compose_levels(scene: Scene, local: Float64) -> Float64:
    """Return world_from_node (N, 4, 4) from parent_from_node (N, 4, 4): a product per level, not per node."""
    world = local.copy()
    for level in scene.nodes.levels[1:]:
        world[level] = world[scene.nodes.parent[level]] @ local[level]
    return world


def pose_bounds(scene: Scene, pose: Pose) -> Float64:
    """Return the (2, 3) corners of a world-space box around all visible instances; zeros if there are none.

    The box of a rigid instance is that of its mesh, moved: its half extents e become |M| e (Arvo,
    "Transforming Axis-Aligned Bounding Boxes", Graphics Gems 1990). Deforming meshes are measured as posed.
    """
    shown = np.flatnonzero(scene.instances.visible)
    if len(shown) == 0:
        return np.zeros((2, 3))
    meshes = scene.instances.mesh[shown]
    low = scene.meshes["bounds_min"][meshes].astype(np.float64)
    high = scene.meshes["bounds_max"][meshes].astype(np.float64)
    for place in np.flatnonzero(np.isin(meshes, list(pose.vertices))):
        positions = pose.vertices[int(meshes[place])][0]
        low[place], high[place] = positions.min(axis=0), positions.max(axis=0)
    matrices = pose.world_from_object[shown]
    center = np.einsum("nij,nj->ni", matrices[:, :3, :3], (low + high) / 2) + matrices[:, :3, 3]
    extent = np.einsum("nij,nj->ni", np.abs(matrices[:, :3, :3]), (high - low) / 2)
    return np.stack([(center - extent).min(axis=0), (center + extent).max(axis=0)])
