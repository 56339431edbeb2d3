"""Scenes made one: everything is drawn where its own scene's transform puts it, and every reference still fits."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from common.environment import Environment
from common.errors import UserError
from common.numerics.transforms import compose, normalize
from common.scene.merge import merge_scenes
from common.scene.pose import evaluate_pose
from tests.support.forests import assert_same_drawing, attached_places, drawn, forest_scene
from tests.support.scenes import quad_scene


def three() -> list:
    return [
        forest_scene(1, deforming=True, animated=True),
        forest_scene(2, 17, copies=True, uv1=True),
        forest_scene(3, 25, animated=True, in_order=False),
    ]


def placements(count: int) -> list[np.ndarray]:
    random = np.random.default_rng(4)
    return [compose(random.normal(size=3) * 9, normalize(random.normal(size=4)), (2, 2, 2))] * count


@pytest.mark.feature("scene/merge-scenes")
@pytest.mark.parametrize("time", [0.0, 0.3, 1.7])
def test_each_scene_is_drawn_as_its_transform_says(time):
    scenes = three()
    transforms = placements(3)
    merged, places = merge_scenes(scenes, transforms, "all")
    expected = [
        one
        for scene, transform in zip(scenes, transforms, strict=True)
        for one in drawn(scene, time, transform)
    ]
    assert_same_drawing(drawn(merged, time), expected)
    world = dict(attached_places(merged, time))
    for scene, transform, place in zip(scenes, transforms, places, strict=True):
        for name, matrix in attached_places(scene, time):
            assert np.allclose(world[name], transform @ matrix, rtol=1e-10, atol=1e-10)
        assert [merged.nodes.names[node] for node in place] == scene.nodes.names
        assert merged.nodes.extras[int(place[5])] == scene.nodes.extras[5]
    assert merged.warnings == ["1: warning", "2: warning", "3: warning"]
    assert np.flatnonzero(merged.nodes.parent < 0).tolist() == [0] and merged.nodes.names[0] == "all"


@pytest.mark.feature("scene/merge-scenes")
def test_there_is_one_node_more_than_in_all_scenes_together():
    scenes = [forest_scene(1, deforming=True), forest_scene(2, 17), forest_scene(3, 25, in_order=False)]
    assert len(merge_scenes(scenes, placements(3))[0].nodes) == 1 + 40 + 17 + 25
    assert len(merge_scenes(three())[0].nodes) == 1 + 40 + 17 + 25
    # A clip drives roots of two of these: a node between keeps the transform from being overwritten.
    assert len(merge_scenes(three(), placements(3))[0].nodes) == 3 + 40 + 17 + 25


@pytest.mark.feature("scene/merge-scenes")
def test_without_transforms_every_bit_stays():
    scenes = three()
    merged, places = merge_scenes(scenes)
    assert_same_drawing(
        drawn(merged, 0.4), [one for scene in scenes for one in drawn(scene, 0.4)], exact=True
    )
    for scene, place in zip(scenes, places, strict=True):
        world = evaluate_pose(scene, 0.4).world_from_node
        assert np.array_equal(evaluate_pose(merged, 0.4).world_from_node[place], world)
    twice, _ = merge_scenes([merged])
    assert_same_drawing(drawn(twice, 0.4), drawn(merged, 0.4), exact=True)


def test_a_scene_that_comes_twice_is_stored_once():
    scene, other = forest_scene(2, 17), forest_scene(3, 25)
    merged, _ = merge_scenes([scene, other, scene], placements(3))
    assert len(merged.positions) == len(scene.positions) + len(other.positions)
    assert len(merged.meshes) == len(merged.mesh_names) == 10
    assert (len(merged.materials), len(merged.images)) == (8, 6)
    expected = [one for part in (scene, other, scene) for one in drawn(part, 0.0, placements(1)[0])]
    assert_same_drawing(drawn(merged), expected)
    bending = forest_scene(1, deforming=True)  # each deforming instance has vertices of its own
    merged, _ = merge_scenes([bending, bending])
    assert len(merged.meshes) == 10 and [one.mesh for one in merged.deformations] == [1, 6]
    assert len(merged.images) == 3


def test_missing_texture_coordinates_and_colours_are_filled():
    plain, rich = forest_scene(1), forest_scene(2, uv1=True)
    colored = replace(quad_scene(), colors=np.full((4, 4), 0.5, np.float32))
    merged, _ = merge_scenes([plain, rich, colored])
    assert merged.uv1 is not None and merged.colors is not None
    assert not merged.uv1[:20].any() and np.array_equal(merged.uv1[20:40], rich.uv1)
    assert (merged.colors[:40] == 1).all() and (merged.colors[40:] == 0.5).all()


def test_an_edit_of_the_merged_scene_leaves_the_others_alone():
    scenes = [forest_scene(1), forest_scene(2)]
    before = [drawn(scene) for scene in scenes]
    merged, places = merge_scenes(scenes)
    with merged.edit() as edit:
        edit.set_transform(int(places[0][0]), matrix=3 * np.eye(4))
        edit.set_material(0, merged.materials[1])
        edit.set_light(0, merged.lights[1])
        edit.set_visible(0, not merged.instances.visible[0])
    for scene, old in zip(scenes, before, strict=True):
        assert_same_drawing(drawn(replace(scene)), old, exact=True)
        assert not any(scene.revision.values())
    assert scenes[0].lights[0].kind == "point"


@pytest.mark.feature("scene/merge-scenes")
def test_what_a_scene_has_once_is_the_first_that_is_given():
    far = Environment("sky", np.ones((2, 4, 3), np.float32))
    scenes = [quad_scene(), replace(quad_scene(), ambient=3.0), replace(quad_scene(), ambient=4.0, ev100=9.0)]
    scenes[2].environment = far
    merged, _ = merge_scenes(scenes)
    assert (merged.ambient, merged.ev100, merged.environment) == (3.0, 9.0, far)
    with pytest.raises(UserError, match=r"no scenes to merge.*\.$"):
        merge_scenes([])
