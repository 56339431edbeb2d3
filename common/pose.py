"""The scene at one time: animation sampled, node matrices composed, deforming meshes posed; float64 numpy."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from common.animation import sample
from common.deform import Vertices, flat, morph, skin
from common.scene import Change, Deformation, Float32, Float64, Pose, Scene
from common.transforms import compose, translation


def evaluate_pose(scene: Scene, time: float) -> Pose:
    """Return where every node, instance and deforming vertex of a scene is at `time` (seconds).

    All clips play at once and loop, except those that would drive what an earlier clip drives already (see
    `common.animation.build_tracks`). Nothing in the scene changes. Without animation the arrays of the last
    pose are returned again until a transform is edited, so `is` tells that nothing moved; they cannot be
    written to.
    """
    still = scene.rest_pose
    revision = scene.revision[Change.TRANSFORMS]
    if still is not None and still[0] == revision:
        return still[1] if still[1].time == time else replace(still[1], time=time)
    nodes = scene.nodes
    parts = {
        "translation": nodes.translation.copy(),
        "rotation": nodes.rotation.copy(),
        "scale": nodes.scale.copy(),
    }
    weights = dict(nodes.weights)
    for track in scene.tracks:
        values = sample(track, time)
        if track.path == "weights":
            weights.update(zip(track.nodes.tolist(), values, strict=True))
        else:
            parts[track.path][track.nodes] = values
    local = compose(**parts)
    local[nodes.has_matrix] = nodes.matrix[nodes.has_matrix]
    world = compose_levels(scene, local)
    world_from_object = world[scene.instances.node]
    if scene.instances.local is not None:
        world_from_object = world_from_object @ scene.instances.local
    vertices = {}
    for deformation in scene.deformations:
        if deformation.joints is not None:
            root = skin_root(deformation, world)
            world_from_object[scene.instances.mesh == deformation.mesh] = root
        vertices[deformation.mesh] = _deformed(scene, deformation, world, weights)
    pose = Pose(time, world, world_from_object, vertices)
    if not scene.tracks:
        for array in (world, world_from_object):
            array.flags.writeable = False
        scene.rest_pose = (revision, pose)
    return pose


def compose_levels(scene: Scene, local: Float64) -> Float64:
    """Return world_from_node (N, 4, 4) from parent_from_node (N, 4, 4): a product per level, not per node."""
    world = local.copy()
    for level in scene.nodes.levels[1:]:
        world[level] = world[scene.nodes.parent[level]] @ local[level]
    return world


def skin_root(deformation: Deformation, world_from_node: Float64) -> Float64:
    """Return the (4, 4) matrix that a skinned instance is drawn with: the place of its first joint.

    The node that carries a skinned mesh has no say in where it appears (glTF 2.0, 3.7.3.3). Vertices relative
    to the skeleton stay small, so they keep their precision as float32 however far from zero the skeleton
    stands.
    """
    assert deformation.joints is not None
    return translation(world_from_node[deformation.joints[0], :3, 3])


def _deformed(
    scene: Scene, deformation: Deformation, world_from_node: Float64, weights: dict[int, Float64]
) -> tuple[Float32, Float32, Float32]:
    row = scene.meshes[deformation.mesh]
    place = slice(int(row["first_vertex"]), int(row["first_vertex"]) + int(row["vertex_count"]))
    vertices: Vertices = (
        scene.positions[place].astype(np.float64),
        scene.normals[place].astype(np.float64),
        scene.tangents[place].astype(np.float64),
    )
    if deformation.morph_positions is not None and deformation.node in weights:
        vertices = morph(
            vertices,
            weights[deformation.node],
            deformation.morph_positions,
            deformation.morph_normals,
            deformation.morph_tangents,
        )
    if deformation.joints is not None:
        assert deformation.inverse_bind is not None
        assert deformation.vertex_joints is not None
        assert deformation.vertex_weights is not None
        world = world_from_node[deformation.joints]
        world[:, :3, 3] -= world_from_node[deformation.joints[0], :3, 3]
        matrices = world @ deformation.inverse_bind
        vertices = skin(vertices, matrices, deformation.vertex_joints, deformation.vertex_weights)
    if deformation.flat:
        vertices = flat(vertices)
    positions, normals, tangents = vertices
    return positions.astype(np.float32), normals.astype(np.float32), tangents.astype(np.float32)


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
