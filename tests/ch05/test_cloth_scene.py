"""Cloth is found in a scene by what its nodes say; the view that is drawn is the same scene; what is wrong is told."""

from __future__ import annotations

import copy
import itertools
from dataclasses import replace

import numpy as np
import pytest

from chapters.ch05.cloth.scene import MOST_VERTICES, cloth_scene
from chapters.ch05.scene_cache.records import put_together, take_apart
from chapters.scenes import load
from common.errors import SceneError
from common.mesh.merge import merged_by_material
from common.numerics.transforms import translation
from common.scene import Change, Deformation
from common.scene.pose import evaluate_pose
from tests.support.cloth_runs import posed
from tests.support.cloth_scenes import cloth, cloth_scene_of

TURNED = np.array([[0, 0, 2, 3.0], [0, 2, 0, 5], [-2, 0, 0, 7], [0, 0, 0, 1]])
MIRRORED = np.diag((-1.0, 1, 1, 1))
SPHERE = {"shape": "sphere", "radius_m": 1.0}


def corners(scene, instance, world_from_object):
    """Return the (T, 3, 3) corners of an instance's triangles in the world."""
    row = scene.meshes[scene.instances.mesh[instance]]
    indices = scene.indices[int(row["first_index"]) :][: int(row["index_count"])] + row["first_vertex"]
    points = scene.positions[indices.reshape(-1, 3)].astype(np.float64)
    return points @ world_from_object[:3, :3].T + world_from_object[:3, 3]


def test_the_view_draws_each_cloth_where_the_scene_does_from_vertices_of_its_own():
    places = (TURNED, np.eye(4), translation((0, 9, 0)) @ MIRRORED)
    scene = cloth_scene_of(cloth(), {}, cloth(), matrices=places)
    found = cloth_scene(scene)
    before, after = evaluate_pose(scene, 0.0), posed(found, 0.0)
    for instance in range(3):
        was = corners(scene, instance, before.world_from_object[instance])
        now = corners(found.scene, instance, after.world_from_object[instance])
        if instance == 2:  # its matrix mirrored: the triangles are wound the other way round now
            now = now[:, ::-1]
        assert np.abs(was - now).max() < 1e-6
    assert len({*found.scene.instances.mesh.tolist()}) == 3
    assert [cloth.node for cloth in found.cloths] == [0, 2] and found.instances.tolist() == [0, 2]
    rows = found.scene.meshes[found.scene.instances.mesh]
    ranges = sorted((int(row["first_vertex"]), int(row["vertex_count"])) for row in rows)
    assert all(a + count <= b for (a, count), (b, _) in itertools.pairwise(ranges))
    assert np.array_equal(after.world_from_object[0], translation((3, 5, 7)))
    normals = found.scene.normals[rows[0]["first_vertex"] :][:25]
    assert np.allclose(normals, (1, 0, 0)), "along the world's axes"
    hands = [set(found.scene.tangents[row["first_vertex"] :][:25, 3].tolist()) for row in (rows[0], rows[2])]
    assert hands == [{1.0}, {-1.0}], "what its matrix mirrored is mirrored in the vertices now"
    assert {one.mesh for one in found.scene.deformations} == {one.mesh for one in found.cloths}


def test_edits_of_the_scene_are_edits_of_its_view():
    scene = cloth_scene_of(cloth(), {})
    found = cloth_scene(scene)
    with scene.edit() as edit:
        edit.set_visible(0, False)
        edit.set_material(0, replace(scene.materials[0], roughness=0.25))
        edit.set_transform(1, matrix=translation((1, 2, 3)))
        edit.set_transform(0, matrix=translation((4, 5, 6)))
    view = found.scene
    assert not view.instances.visible[0] and view.materials[0].roughness == 0.25
    assert all(view.revision[kind] == scene.revision[kind] for kind in Change)
    pose = posed(found, 1.0)
    assert np.array_equal(pose.world_from_object[1], translation((1, 2, 3)))
    assert np.array_equal(pose.world_from_object[0], np.eye(4)), "a cloth stays where it is anchored"
    assert np.array_equal(pose.world_from_node[0], translation((4, 5, 6))), "and what holds it goes along"
    assert np.array_equal(view.origin, scene.origin) and np.array_equal(view.bounds, scene.bounds)


def test_a_scene_without_cloth_or_without_its_setting_is_drawn_itself():
    scene = cloth_scene_of({}, {})
    assert cloth_scene(scene).scene is scene
    dressed = cloth_scene_of(cloth())
    found = cloth_scene(dressed, on=False)
    assert found.scene is dressed and not found.cloths
    assert posed(found, 0.0) is evaluate_pose(dressed, 0.0)


def test_the_atrium_and_the_scene_of_fabric_hang_what_their_files_say():
    atrium = cloth_scene(load("atrium:small"))
    assert len(atrium.cloths) == 6 and not atrium.obstacles
    assert all(one.held.sum() > 2 and not one.warnings for one in atrium.cloths)
    scene = load("cloth:small")
    fabric = cloth_scene(scene)
    assert [scene.nodes.names[one.node] for one in fabric.cloths] == ["sheet", "throw", "flag", "curtain"]
    assert [one.shape for one in fabric.obstacles] == ["plane", "sphere", "box"]
    plane, ball, box = fabric.colliders(posed(fabric, 0.0))
    assert np.allclose(plane.world_from_collider[:3, 1], (0, 1, 0))
    assert ball.radius == pytest.approx(0.55, abs=1e-3)
    assert np.allclose(box.half, 0.35, atol=1e-3)
    assert np.allclose(box.world_from_collider[:3, 3], (-1.65, 0.35, 1.7), atol=1e-3)
    assert [text for text in scene.warnings if "no pins" in text] == scene.warnings[-2:], "two fall freely"


def test_colliders_follow_their_nodes():
    stones = [({"shape": "sphere", "radius_m": 0.5}, TURNED), ({"shape": "plane"}, np.diag((1.0, 3, 2, 1)))]
    scene = cloth_scene_of(cloth(), colliders=stones)
    found = cloth_scene(scene)
    ball, plane = found.colliders(posed(found, 0.0))
    assert ball.radius == pytest.approx(1.0) and np.allclose(ball.world_from_collider[:3, 3], (3, 5, 7))
    up = plane.world_from_collider
    assert np.allclose(up[:3, 1], (0, 1, 0)) and np.allclose(up[:3, :3] @ up[:3, :3].T, np.eye(3))
    tipped = np.eye(4)
    tipped[:3, :3] = [[0, -1, 0], [1, 0, 0], [0, 0, 1]]
    with scene.edit() as edit:
        edit.set_transform(2, matrix=tipped)
    assert np.allclose(
        found.colliders(posed(found, 0.0))[1].world_from_collider[:3, 1],
        (-1, 0, 0),
    )


@pytest.mark.parametrize(
    ("said", "words"),
    [
        (7, "is 7: write an object"),
        ({"pinz": [0]}, "unknown field 'pinz'; did you mean 'pins'?"),
        (cloth(pins=[99]), "pinned at vertex 99"),
        (cloth(pins=[True]), "pins"),
        (cloth() | {"pins": "all"}, "pins"),
        (cloth(kg_per_m2=-1), "kg_per_m2 = -1"),
        (cloth(kg_per_m2=0), "kg_per_m2 = 0"),
        (cloth(stretch_n_per_m=float("nan")), "stretch_n_per_m = nan"),
        (cloth(shear_n_per_m="soft"), "shear_n_per_m = 'soft'"),
        (cloth(damping_per_s=-0.1), "damping_per_s = -0.1"),
        (cloth(columns=7), "columns = 7"),
    ],
)
def test_a_property_that_is_wrong_is_one_sentence_with_node_and_field(said, words):
    with pytest.raises(SceneError) as error:
        cloth_scene(cloth_scene_of(said))
    text = str(error.value)
    assert words in text and "node 0 'sheet 0'" in text and "\n" not in text


@pytest.mark.parametrize(
    ("said", "at", "words"),
    [
        ({"shape": "cone"}, np.eye(4), "'shape'"),
        ({}, np.eye(4), "'shape'"),
        ("ball", np.eye(4), "write an object"),
        ({"shape": "sphere"}, np.eye(4), "without a size: give it 'radius_m', or a mesh"),
        ({"shape": "box"}, np.eye(4), "without a size: give it a mesh"),
        ({"shape": "plane", "radius_m": 1}, np.eye(4), "means nothing for a plane"),
        ({"shape": "sphere", "radius_m": -1}, np.eye(4), "'radius_m'"),
        ({"shape": "sphere", "radius_m": float("inf")}, np.eye(4), "'radius_m'"),
        (SPHERE | {"radius": 1}, np.eye(4), "unknown field 'radius'; did you mean 'radius_m'?"),
        (SPHERE, np.diag((1.0, 2, 1, 1)), "stretches"),
        (SPHERE, np.diag((0.0, 1, 1, 1)), "squeezed flat"),
    ],
)
def test_a_collider_that_is_wrong_is_one_sentence_with_its_node(said, at, words):
    with pytest.raises(SceneError) as error:
        cloth_scene(cloth_scene_of(cloth(), colliders=[(said, at)]))
    assert words in str(error.value) and "node 1 'stone 0'" in str(error.value)


def test_nodes_that_cannot_be_cloth_are_refused_by_name():
    scene = cloth_scene_of(cloth(), {})
    scene.nodes.extras[2] = {"strata": {"cloth": cloth()}}
    with pytest.raises(SceneError, match=r"Node 2 'sun' has extras\.strata\.cloth but no mesh"):
        cloth_scene(scene)
    scene = cloth_scene_of(cloth(), {})
    scene.instances.node[1] = 0
    with pytest.raises(SceneError, match="consists of 2 primitives"):
        cloth_scene(scene)
    with pytest.raises(SceneError, match="skin or morph targets"):
        cloth_scene(replace(cloth_scene_of(cloth()), deformations=[Deformation(0, 0)]))
    with pytest.raises(SceneError, match="squeezed flat"):
        cloth_scene(cloth_scene_of(cloth(), matrices=[np.diag((1.0, 1, 0, 1))]))
    large = cloth_scene_of(cloth(400, 400, [0]), size=(400, 400))
    assert len(large.positions) > MOST_VERTICES
    with pytest.raises(SceneError, match=f"{400 * 400} vertices, and {MOST_VERTICES}"):
        cloth_scene(large)
    many = cloth_scene_of(cloth(), colliders=[(SPHERE, np.eye(4))] * 65)
    with pytest.raises(SceneError, match="65 nodes with"):
        cloth_scene(many)


def test_what_is_odd_but_can_be_simulated_is_told_once():
    scene = cloth_scene_of(cloth(pins=[]))
    for _ in range(2):
        cloth_scene(scene)
    assert len(scene.warnings) == 1 and "no pins" in scene.warnings[0]
    assert "node 0 'sheet 0'" in scene.warnings[0]
    lone = cloth_scene_of(cloth(2, 2, [0]), size=(2, 2))
    lone.meshes["index_count"] = 3
    assert len(cloth_scene(lone).cloths[0].triangles) == 1


def test_cache_and_merge_keep_what_nodes_say(tmp_path):
    scene = cloth_scene_of(cloth(), {}, {}, cloth(), colliders=[(SPHERE, np.eye(4))])
    arrays: list[np.ndarray] = []

    def add(array: np.ndarray) -> int:
        arrays.append(array)
        return len(arrays) - 1

    again = put_together(take_apart(scene, add), arrays.__getitem__, [], tmp_path)
    merged = merged_by_material(scene).scene
    assert len(merged.instances) == 3, "the two plain sheets are one"
    for other in (again, merged, copy.deepcopy(scene)):
        found = cloth_scene(other)
        assert len(found.cloths) == 2 and [one.radius for one in found.obstacles] == [1.0]
        assert found.cloths[0].held.sum() == 5
