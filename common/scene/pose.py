"""The scene at one time: animation sampled, node matrices composed, deforming meshes posed; float64 numpy."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from itertools import takewhile

import numpy as np
from numpy.typing import ArrayLike, NDArray

from common.numerics.transforms import compose, translation
from common.scene import Change, Deformation, Float32, Float64, Nodes, Pose, Scene
from common.scene.animation import Track, sample
from common.scene.deform import Vertices, flat, morph, skin

FEW = 256
"""Nodes: fewer are all computed anew, since finding out which of them must be takes 0.1 ms."""


def evaluate_pose(scene: Scene, time: float) -> Pose:
    """Return where every node, instance and deforming vertex of a scene is at `time` (seconds).

    All clips play at once and loop, except those that would drive what an earlier clip drives already (see
    `common.scene.animation.build_tracks`). Nothing in the scene changes. Without animation the arrays of the last
    pose are returned again until a transform is edited, so `is` tells that nothing moved; they cannot be
    written to. After an edit only what hangs on the edited nodes is computed, and for a time only what hangs on
    nodes that clips drive, to the same bits as everything would be.
    """
    if scene.tracks and scene.driven_levels is None:
        return _pose(scene, time, None, [])
    rest = _rest_pose(scene)
    if scene.tracks:
        return _pose(scene, time, rest, scene.driven_levels or [])
    if rest.time != time:
        rest = replace(rest, time=time)
        scene.rest_pose = (scene.revision[Change.TRANSFORMS], rest)
    return rest


def driven_levels(scene: Scene) -> list[NDArray[np.intp]] | None:
    """Return the nodes that hang on those which clips move, by depth; None where all are computed anew."""
    driven = [track.nodes for track in scene.tracks if track.path != "weights"]
    return _unless_most(scene, np.concatenate(driven) if driven else ())


def _unless_most(scene: Scene, nodes: ArrayLike) -> list[NDArray[np.intp]] | None:
    """Return what hangs on `nodes`, or None where picking that out would cost more than it saves."""
    if len(scene.nodes) < FEW:
        return None
    levels = scene.nodes.ancestry.levels_below(nodes)
    return levels if 2 * sum(map(len, levels)) <= len(scene.nodes) else None


def _rest_pose(scene: Scene) -> Pose:
    """Return the pose without clips, the last one as long as no transform is edited."""
    still = scene.rest_pose
    revision = scene.revision[Change.TRANSFORMS]
    if still is not None and still[0] == revision:
        return still[1]
    levels = None
    if (
        still is not None
    ):  # views of a scene share its nodes, and each has a pose of its own to bring up to date
        since = takewhile(lambda entry: entry[1] > still[0], reversed(scene.nodes.edited.items()))
        levels = _unless_most(scene, [node for node, _ in since])
    if still is None or levels is None:
        pose = _pose(scene, None, None, [])
    else:
        pose = _pose(scene, None, still[1], levels)
    for array in (pose.world_from_node, pose.world_from_object):
        array.flags.writeable = False
    scene.rest_pose = (revision, pose)
    return pose


def _pose(scene: Scene, time: float | None, before: Pose | None, levels: list[NDArray[np.intp]]) -> Pose:
    """Return the pose at `time`, at rest if that is None; `levels` of nodes are other than in `before`.

    Without `before` all are. Its arrays stay what they are, since a renderer may need them as the previous
    frame's.
    """
    nodes, instances = scene.nodes, scene.instances
    sampled = [] if time is None else [(track, sample(track, time)) for track in scene.tracks]
    weights = dict(nodes.weights)
    for track, values in sampled:
        if track.path == "weights":
            weights.update(zip(track.nodes.tolist(), values, strict=True))
    if before is None:
        world = local_matrices(nodes, sampled=sampled)
        nodes.ancestry.compose(world, nodes.ancestry.levels)
        world_from_object = world[instances.node]
        if instances.local is not None:
            world_from_object = world_from_object @ instances.local
        moved, vertices = np.ones(len(nodes), bool), {}
    else:
        moved = np.zeros(len(nodes), bool)
        for level in levels:
            moved[level] = True
        rows = np.flatnonzero(moved)
        world = before.world_from_node.copy()
        world[rows] = local_matrices(nodes, rows, sampled)
        nodes.ancestry.compose(world, levels)
        world_from_object = before.world_from_object.copy()
        drawn = np.flatnonzero(moved[instances.node])
        matrices = world[instances.node[drawn]]
        world_from_object[drawn] = matrices if instances.local is None else matrices @ instances.local[drawn]
        vertices = dict(before.vertices)
    for deformation in scene.deformations:
        joints, mesh = deformation.joints, deformation.mesh
        if joints is not None:
            world_from_object[instances.mesh == mesh] = skin_root(deformation, world)
        bent = weights.get(deformation.node) is not nodes.weights.get(deformation.node)
        if mesh not in vertices or bent or (joints is not None and moved[joints].any()):
            vertices[mesh] = _deformed(scene, deformation, world, weights)
    return Pose(time or 0.0, world, world_from_object, vertices)


def local_matrices(
    nodes: Nodes, rows: NDArray[np.intp] | None = None, sampled: Iterable[tuple[Track, Float64]] = ()
) -> Float64:
    """Return parent_from_node (K, 4, 4) of the nodes `rows`, ascending, or of all.

    At rest, except for what clips drive: `sampled` are their tracks and values. A driven node must be in `rows`.
    """
    chosen = slice(None) if rows is None else rows
    parts = {
        "translation": np.array(nodes.translation[chosen]),
        "rotation": np.array(nodes.rotation[chosen]),
        "scale": np.array(nodes.scale[chosen]),
    }
    for track, values in sampled:
        if track.path != "weights":
            places = track.nodes if rows is None else np.searchsorted(rows, track.nodes)
            parts[track.path][places] = values
    local = compose(**parts)
    fixed = nodes.has_matrix[chosen]
    local[fixed] = nodes.matrix[chosen][fixed]
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
