"""A pose after an edit: the bits of the whole composition, for the work of what hangs on the edited nodes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from common.numerics.transforms import compose
from common.scene import Pose
from common.scene.pose import FEW, evaluate_pose
from tests.support.forests import forest_scene

COUNT = FEW + 44
"""Nodes: enough that not all are computed anew."""


def assert_same(pose: Pose, other: Pose) -> None:
    """Assert that two poses have the same bits."""
    assert np.array_equal(pose.world_from_node, other.world_from_node)
    assert np.array_equal(pose.world_from_object, other.world_from_object)
    assert pose.vertices.keys() == other.vertices.keys()
    for mesh, parts in pose.vertices.items():
        assert all(np.array_equal(a, b) for a, b in zip(parts, other.vertices[mesh], strict=True))


@pytest.mark.parametrize("deforming", [False, True])
@pytest.mark.parametrize("copies", [False, True])
@pytest.mark.parametrize("seed", range(3))
def test_edits_give_the_bits_of_the_whole_composition(seed, copies, deforming):
    scene = forest_scene(seed, COUNT, copies=copies, deforming=deforming)
    joints = np.flatnonzero(scene.nodes.ancestry.sizes == 1)[:3].astype(np.int32)
    scene = replace(scene, deformations=[replace(one, joints=joints) for one in scene.deformations])
    random = np.random.default_rng(seed + 100)
    for _ in range(15):
        before = evaluate_pose(scene, 0.0)
        kept = before.world_from_node.copy(), before.world_from_object.copy()
        for _ in range(random.integers(1, 4)):
            with scene.edit() as edit:
                chosen = random.integers(0, COUNT, random.integers(0, 3))
                for node in [*chosen.tolist(), *joints[: random.integers(0, 2)].tolist()]:
                    if scene.nodes.has_matrix[node] or random.random() < 0.2:
                        edit.set_transform(
                            node, matrix=compose(random.normal(size=3), (0, 0, 0, 1), (1, 2, 1))
                        )
                    else:
                        edit.set_transform(node, translation=tuple(random.normal(size=3)))
        after = evaluate_pose(scene, 1.5)
        whole = evaluate_pose(replace(scene), 1.5)  # a new scene has no earlier pose
        assert after.time == 1.5
        assert_same(after, whole)
        assert np.array_equal(before.world_from_node, kept[0])  # a renderer may still hold it
        assert np.array_equal(before.world_from_object, kept[1])
        assert not after.world_from_object.flags.writeable


@pytest.mark.parametrize("deforming", ["", "skin", "morph"])
@pytest.mark.parametrize("copies", [False, True])
def test_a_time_gives_the_bits_of_the_whole_composition(copies, deforming):
    """Clips drive some nodes, and edits come between the frames, of nodes that are driven too."""
    compared = 0
    for seed in range(6):
        scene = forest_scene(seed, COUNT, copies=copies, deforming=bool(deforming), animated=True)
        if deforming == "morph":
            parts = dict.fromkeys(("joints", "inverse_bind", "vertex_joints", "vertex_weights"))
            scene = replace(scene, deformations=[replace(scene.deformations[0], **parts)])
        random = np.random.default_rng(seed)
        for _ in range(5):
            with scene.edit() as edit:
                edit.set_transform(4, scale=tuple(random.uniform(1, 2, 3)))
                edit.set_transform(
                    int(random.integers(5, COUNT)),
                    matrix=compose(random.normal(size=3), (0, 0, 0, 1), (2, 1, 1)),
                )
            time = float(random.random())
            partly, whole = evaluate_pose(scene, time), replace(scene)
            whole.driven_levels = None  # what a scene has whose clips move most of its nodes
            rest = scene.nodes.translation.copy()
            assert_same(partly, evaluate_pose(whole, time))
            assert np.array_equal(scene.nodes.translation, rest)
            compared += scene.driven_levels is not None
    assert compared >= 10


def test_nodes_that_hang_on_no_edited_one_are_not_computed():
    """Their places are overwritten behind the scene's back: whoever composed them would see it."""
    scene = forest_scene(1, COUNT)
    before = evaluate_pose(scene, 0.0)
    node = int(np.flatnonzero(scene.nodes.ancestry.sizes == 3)[0])
    below = scene.nodes.ancestry.subtrees([node])
    others = np.setdiff1d(np.arange(COUNT), below)
    scene.nodes.translation[others] = scene.nodes.matrix[others] = np.nan
    with scene.edit() as edit:
        edit.set_transform(node, matrix=np.eye(4))
    after = evaluate_pose(scene, 0.0)
    assert np.array_equal(after.world_from_node[others], before.world_from_node[others])
    assert not np.array_equal(after.world_from_node[below], before.world_from_node[below])
    assert np.isfinite(after.world_from_object).all()
    scene.nodes.matrix[below] = np.nan  # the next edit pays for its own nodes alone
    with scene.edit() as edit:
        edit.set_transform(int(others[-1]), matrix=np.eye(4))
    assert np.array_equal(evaluate_pose(scene, 0.0).world_from_node[below], after.world_from_node[below])


def test_views_of_a_scene_follow_edits_of_either():
    scene = forest_scene(3, COUNT)
    view = replace(scene, name="with another light")
    for number, edited in enumerate((scene, view, scene)):
        with edited.edit() as edit:
            edit.set_transform(7 + number, matrix=(2.0 + number) * np.eye(4))
        whole = evaluate_pose(replace(scene), 0.0)
        for one in (scene, view) if number < 2 else (view,):
            assert_same(evaluate_pose(one, 0.0), whole)


def test_a_pose_in_the_middle_of_an_edit_loses_nothing():
    scene = forest_scene(2, COUNT)
    for matrix in (2 * np.eye(4), 3 * np.eye(4)):
        with scene.edit() as edit:
            edit.set_transform(5, matrix=matrix)
            evaluate_pose(scene, 0.0)
            edit.set_transform(6, matrix=matrix)
    assert np.array_equal(
        evaluate_pose(scene, 0.0).world_from_node, evaluate_pose(replace(scene), 0.0).world_from_node
    )


def test_an_edit_names_a_node_that_is_there():
    scene = forest_scene(0, 6)
    for node in (-1, 6):
        with pytest.raises(IndexError, match=f"no node {node} among 6"), scene.edit() as edit:
            edit.set_transform(node, matrix=np.eye(4))
