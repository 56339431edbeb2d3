"""The scene at one time: animation sampled, node matrices composed, deforming meshes posed; float64 numpy."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from common.animation import sample
from common.deform import Vertices, flat, morph, skin
from common.scene import Change, Deformation, Float32, Float64, Nodes, Pose, Scene
from common.transforms import compose, translation


def evaluate_pose(scene: Scene, time: float) -> Pose:
    """Return where every node, instance and deforming vertex of a scene is at `time` (seconds).

    All clips play at once and loop, except those that would drive what an earlier clip drives already (see
    `common.animation.build_tracks`). Nothing in the scene changes. Without animation the arrays of the last
    pose are returned again until a transform is edited, so `is` tells that nothing moved; they cannot be
    written to. After an edit only what hangs on the edited nodes is computed, to the same bits as everything
    would be.
    """
    still = scene.rest_pose
    revision = scene.revision[Change.TRANSFORMS]
    if still is not None and still[0] == revision:
        return replace(still[1], time=time)
    edited, scene.edited_nodes = scene.edited_nodes, set()
    pose = None if still is None else _pose_after(scene, still[1], edited, time)
    pose = pose or _whole_pose(scene, time)
    if not scene.tracks:
        for array in (pose.world_from_node, pose.world_from_object):
            array.flags.writeable = False
        scene.rest_pose = (revision, pose)
    return pose


def _whole_pose(scene: Scene, time: float) -> Pose:
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
    world = compose(**parts)
    world[nodes.has_matrix] = nodes.matrix[nodes.has_matrix]
    nodes.ancestry.compose(world, nodes.ancestry.levels)
    world_from_object = world[scene.instances.node]
    if scene.instances.local is not None:
        world_from_object = world_from_object @ scene.instances.local
    vertices = {}
    for deformation in scene.deformations:
        if deformation.joints is not None:
            root = skin_root(deformation, world)
            world_from_object[scene.instances.mesh == deformation.mesh] = root
        vertices[deformation.mesh] = _deformed(scene, deformation, world, weights)
    return Pose(time, world, world_from_object, vertices)


def _pose_after(scene: Scene, before: Pose, edited: set[int], time: float) -> Pose | None:
    """Return the pose of a scene without animation after the transforms of the nodes `edited` changed.

    The arrays of `before` stay what they are, since a renderer may need them as the previous frame's. None
    where most nodes hang on the edited ones, so that picking them out would cost more than it saves.
    """
    nodes, instances = scene.nodes, scene.instances
    levels = nodes.ancestry.levels_below(list(edited))
    if 2 * sum(map(len, levels)) > len(nodes):
        return None
    world = before.world_from_node.copy()
    moved = np.zeros(len(nodes), bool)
    for level in levels:
        moved[level] = True
    touched = np.flatnonzero(moved)
    world[touched] = local_matrices(nodes, touched)
    nodes.ancestry.compose(world, levels)
    world_from_object = before.world_from_object.copy()
    drawn = np.flatnonzero(moved[instances.node])
    matrices = world[instances.node[drawn]]
    world_from_object[drawn] = matrices if instances.local is None else matrices @ instances.local[drawn]
    vertices = dict(before.vertices)
    for deformation in scene.deformations:  # one without joints moves as its instance does
        if deformation.joints is not None:
            root = skin_root(deformation, world)
            world_from_object[instances.mesh == deformation.mesh] = root
            if moved[deformation.joints].any():
                vertices[deformation.mesh] = _deformed(scene, deformation, world, nodes.weights)
    return Pose(time, world, world_from_object, vertices)


def local_matrices(nodes: Nodes, rows: NDArray[np.intp] | slice = slice(None)) -> Float64:
    """Return parent_from_node (K, 4, 4) of the nodes `rows` at rest."""
    local = compose(nodes.translation[rows], nodes.rotation[rows], nodes.scale[rows])
    chosen = nodes.has_matrix[rows]
    local[chosen] = nodes.matrix[rows][chosen]
    return local


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
