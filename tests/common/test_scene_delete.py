"""Nodes taken out of a scene: what is left is drawn where it was, and what nothing uses can be dropped."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from common.errors import UserError
from common.scene.delete import delete_nodes, without_unused
from common.scene.pose import evaluate_pose
from tests.support.forests import assert_same_drawing, attached_places, drawn, forest_scene


def below(scene, chosen) -> set[int]:
    """Return the chosen nodes and all below them, by looking upwards from each."""
    found = set()
    for node in range(len(scene.nodes)):
        above = node
        while above >= 0 and above not in chosen:
            above = int(scene.nodes.parent[above])
        if above >= 0:
            found.add(node)
    return found


@pytest.mark.feature("scene/delete-nodes")
@pytest.mark.parametrize("in_order", [True, False])
@pytest.mark.parametrize("seed", range(5))
def test_what_is_left_is_drawn_where_it_was(seed, in_order):
    scene = forest_scene(seed, copies=seed % 2 == 0, animated=True, in_order=in_order)
    chosen = set(np.random.default_rng(seed).integers(1, 40, 4).tolist())
    gone = below(scene, chosen)
    left, place = delete_nodes(scene, list(chosen))
    assert set(np.flatnonzero(place < 0).tolist()) == gone
    for time in (0.0, 0.6):
        stays = [
            one
            for one, node in zip(drawn(scene, time), scene.instances.node.tolist(), strict=True)
            if node not in gone
        ]
        assert_same_drawing(drawn(left, time), stays, exact=True)
        names = {scene.nodes.names[node] for node in gone}
        names |= {one.name for one in (*scene.lights, *scene.cameras) if one.node in gone}
        expected = [(name, matrix) for name, matrix in attached_places(scene, time) if name not in names]
        found = attached_places(left, time)
        assert [name for name, _ in found] == [name for name, _ in expected]
        assert all(np.array_equal(a, b) for (_, a), (_, b) in zip(found, expected, strict=True))
    assert [len(one.channels) for one in left.animations] == [
        n for one in scene.animations if (n := sum(channel.node not in gone for channel in one.channels))
    ]
    assert left.nodes.extras == ({} if 5 in gone else {int(place[5]): {"note": seed}})


@pytest.mark.feature("scene/delete-nodes")
def test_deleting_nothing_changes_nothing_and_deleting_everything_leaves_an_empty_scene():
    scene = forest_scene(3, deforming=True, animated=True)
    same, place = delete_nodes(scene, [])
    assert place.tolist() == list(range(40))
    assert_same_drawing(drawn(same, 0.3), drawn(scene, 0.3), exact=True)
    assert same.positions is scene.positions
    with same.edit() as edit:
        edit.set_transform(1, matrix=np.eye(4))
        edit.set_material(0, same.materials[1])
        edit.set_visible(0, not same.instances.visible[0])
    assert_same_drawing(
        drawn(replace(scene), 0.3), drawn(forest_scene(3, deforming=True, animated=True), 0.3)
    )
    assert not any(scene.revision.values())
    empty, _ = delete_nodes(scene, np.flatnonzero(scene.nodes.parent < 0))
    assert len(empty.nodes) == len(empty.instances) == empty.triangle_count == 0
    assert not (empty.lights or empty.cameras or empty.animations or empty.deformations)
    assert len(evaluate_pose(empty, 0.0).world_from_node) == 0
    bare = without_unused(empty)
    assert len(bare.positions) == len(bare.indices) == len(bare.meshes) == 0
    assert not (bare.materials or bare.images or bare.mesh_names)
    with pytest.raises(IndexError, match="no node 40 among 40"):
        delete_nodes(scene, [40])


def test_a_skin_goes_with_its_mesh_and_keeps_its_joints():
    scene = forest_scene(6, deforming=True)
    parent = np.full(40, -1, np.int32)
    scene = replace(scene, nodes=replace(scene.nodes, parent=parent))
    left, place = delete_nodes(scene, [0, 10])
    assert left.deformations[0].joints.tolist() == place[[3, 4, 5]].tolist() == [2, 3, 4]
    assert left.deformations[0].node == 1 and left.nodes.weights.keys() == {1}
    stays = [
        one
        for one, node in zip(drawn(scene), scene.instances.node.tolist(), strict=True)
        if node not in (0, 10)
    ]
    assert_same_drawing(drawn(left), stays, exact=True)
    assert delete_nodes(scene, [2])[0].deformations == []
    assert delete_nodes(scene, [2, 4])[0].deformations == []
    with pytest.raises(UserError) as caught:
        delete_nodes(scene, [4])
    assert str(caught.value) == (
        "Node 4 ('6: node 4') cannot be deleted alone, since it is a joint of mesh '6: mesh 1': "
        "delete node 2 ('6: node 2') too."
    )


@pytest.mark.parametrize("seed", range(4))
def test_what_nothing_draws_is_dropped_and_the_picture_stays(seed):
    scene = forest_scene(seed, copies=seed == 1, deforming=seed == 2, uv1=seed == 3)
    chosen = np.flatnonzero(np.isin(scene.instances.mesh, (0, 3)))
    gone = np.unique(scene.instances.node[chosen])
    scene = replace(scene, nodes=replace(scene.nodes, parent=np.full(40, -1, np.int32)))
    if scene.deformations:
        gone = np.setdiff1d(gone, (2, 3, 4, 5))
    left, _ = delete_nodes(scene, gone)
    small = without_unused(left)
    assert_same_drawing(drawn(small), drawn(left), exact=True)
    used = set(left.instances.mesh.tolist())
    assert len(small.meshes) == len(small.mesh_names) == len(used)
    assert len(small.positions) == 4 * len(used) and len(small.indices) == 6 * len(used)
    assert len(small.materials) == len({left.meshes["material"][mesh] for mesh in used})
    assert {image.name for image in small.images} == {
        left.images[texture.image].name
        for mesh in used
        for texture in left.materials[left.meshes["material"][mesh]].textures().values()
    }
    assert (small.uv1 is None) == (scene.uv1 is None)
    assert_same_drawing(drawn(without_unused(small)), drawn(small), exact=True)


def test_meshes_that_share_vertices_still_share_them():
    scene = forest_scene(0)
    meshes = scene.meshes.copy()
    meshes["first_vertex"] = (4, 4, 6, 4, 16)
    meshes["vertex_count"] = (4, 4, 4, 4, 4)
    meshes["first_index"] = (6, 6, 6, 6, 24)
    scene = replace(scene, meshes=meshes)
    small = without_unused(scene)
    assert len(small.positions) == 10 and len(small.indices) == 12
    assert_same_drawing(drawn(small), drawn(scene), exact=True)
