"""Records as shaders read them: materials and instances, from the ordinary to the absurd."""

from __future__ import annotations

import math
from dataclasses import replace
from inspect import signature

import numpy as np

from chapters.ch01.scene.packing import ROLES, back_to_front, pack_instances, pack_materials
from common import layouts
from common.numerics.transforms import pose_looking_at
from common.scene import Material
from common.scene.pose import evaluate_pose
from tests.support.scenes import quad_scene, texture, translated


def test_a_material_s_record_holds_all_its_numbers():
    material = Material(
        base_color=(0.1, 0.2, 0.3, 0.4),
        metallic=0.5,
        roughness=0.6,
        emissive=(7.0, 8.0, 1e39),
        normal_scale=0.9,
        occlusion_strength=0.25,
        alpha_cutoff=0.75,
        occlusion_texture=texture(offset=(0.5, 0.25), scale=(2.0, 3.0), uv_set=1),
        emissive_texture=texture(rotation=math.pi / 2),
    )
    # From chapter 2 on a record also says which textures the material samples.
    more = {"maps": np.zeros((1, 8), np.uint32)} if "maps" in signature(pack_materials).parameters else {}
    (record,) = pack_materials([material], **more)
    assert np.allclose(record["base_color"], material.base_color)
    assert np.allclose(record["factors"], (0.5, 0.6, 0.9, 0.25))
    assert np.allclose(record["emissive"][[0, 1, 3]], (7, 8, 0.75))
    assert np.isfinite(record["emissive"]).all()
    rows = record["uv_rows"].reshape(5, 2, 4)
    for role, name in enumerate(ROLES):
        expected = material.textures()[name].matrix() if name in material.textures() else np.eye(2, 3)
        assert np.allclose(rows[role, :, :3], expected)
        assert rows[role, 0, 3] == (name == "occlusion")
    # A quarter turn of KHR_texture_transform takes (u, v) to (v, -u).
    assert np.allclose(rows[4, :, :3] @ (0.25, 0.75, 1.0), (0.75, -0.25), atol=1e-7)


def test_instances_know_their_place_and_whether_they_are_mirrored():
    scene = quad_scene(
        matrices=(translated(1.0), np.diag((-2.0, 1.0, 1.0, 1.0)), np.diag((-1.0, -1.0, 1.0, 1.0)))
    )
    scene = replace(
        scene,
        instances=replace(scene.instances, node=np.arange(3, dtype=np.int32), mesh=np.zeros(3, np.int32)),
    )
    scene.instances.visible = np.array((True, False, True))
    records = pack_instances(scene, evaluate_pose(scene, 0.0), None)
    assert records["id"].tolist() == [0, 1, 2]
    assert ((records["flags"] & layouts.INSTANCE_MIRRORED) != 0).tolist() == [False, True, False]
    assert ((records["flags"] & layouts.INSTANCE_MOVED) != 0).tolist() == [False, False, False]
    place = records["world_from_object"][0] @ (0, 0, 0, 1)
    assert np.allclose(place + scene.origin, (1, 0, 0))


def test_the_farthest_is_first_and_equals_keep_their_order():
    view = np.linalg.inv(pose_looking_at((0.0, 0.0, 10.0), (0.0, 0.0, 0.0)))
    centers = np.array([(0, 0, 1), (5, 5, -3), (0, 0, 4), (1, 2, 1), (0, 0, -3)], np.float64)
    assert back_to_front(centers, view).tolist() == [1, 4, 0, 3, 2]
    assert back_to_front(centers[:0], view).tolist() == []
