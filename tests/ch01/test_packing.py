"""Records as shaders read them: materials, instances and lights, from the ordinary to the absurd."""

from __future__ import annotations

import math
from dataclasses import replace
from inspect import signature

import numpy as np
import pytest

from chapters.ch01.scene.packing import (
    LIGHT_KINDS,
    ROLES,
    back_to_front,
    cutoff_distance,
    pack_instances,
    pack_lights,
    pack_materials,
)
from common import layouts
from common.numerics.transforms import pose_looking_at
from common.scene import Light, Material
from common.scene.pose import evaluate_pose
from tests.support.scenes import nodes_at, quad_scene, texture, translated


def packed(light, node=None, exposure=1.0, cutoff=0.0, origin=None):
    """Return the record of one light at `node` (4, 4)."""
    scene = quad_scene(lights=(light,))
    scene = replace(scene, nodes=nodes_at(np.eye(4), np.eye(4) if node is None else node))
    if origin is not None:
        scene.origin = np.array(origin, np.float64)
    return pack_lights(scene, evaluate_pose(scene, 0.0), exposure, cutoff)[0]


def test_a_light_is_placed_and_directed_by_its_node():
    node = pose_looking_at((3.0, 4.0, 5.0), (3.0, 0.0, 5.0), (0.0, 0.0, -1.0))
    record = packed(
        Light("spot", node=1, intensity=2.0, color=(1.0, 0.5, 0.25)), node @ np.diag((7.0, 7, 7, 1)), 0.5
    )
    assert record["kind"] == LIGHT_KINDS["spot"] == 1
    assert np.allclose(record["position"], (3, 4, 5))
    assert np.allclose(record["direction"], (0, -1, 0), atol=1e-7), "scale changes no direction"
    assert np.allclose(record["color"], (1.0, 0.5, 0.25)), "intensity times exposure"


def test_positions_are_relative_to_the_origin_before_they_are_rounded():
    far = 1e7
    record = packed(Light("point", node=1), translated(far + 0.125), origin=(far, 0.0, 0.0))
    assert record["position"][0] == 0.125


def test_the_cone_is_one_inside_and_zero_outside():
    """glTF: ((cos - cos outer) / (cos inner - cos outer))^2, clamped; scale and offset are those of the line."""
    inner, outer = 0.3, 0.7
    scale, offset = packed(Light("spot", node=1, inner_cone=inner, outer_cone=outer))["cone"][:2].astype(
        np.float64
    )
    assert scale * math.cos(inner) + offset == pytest.approx(1.0, abs=1e-6)
    assert scale * math.cos(outer) + offset == pytest.approx(0.0, abs=1e-6)
    equal = packed(Light("spot", node=1, inner_cone=0.5, outer_cone=0.5))["cone"]
    assert equal[0] == pytest.approx(1000.0), (
        "cones of no width are the steepest line that the extension's code has"
    )


@pytest.mark.parametrize("kind", ["point", "spot", "directional"])
@pytest.mark.parametrize("intensity", [0.0, 1e-30, 1.0, 1e30, 1e300])
@pytest.mark.parametrize("reach", [1e-320, 1e-200, 1e-3, 1e3, 1e200, math.inf])
@pytest.mark.parametrize("cutoff", [0.0, 1e-300, 1e-3])
def test_records_are_finite_whatever_the_file_says(kind, intensity, reach, cutoff):
    record = packed(Light(kind, node=1, intensity=intensity, range=reach), exposure=2.0, cutoff=cutoff)
    for name in record.dtype.names:
        assert np.isfinite(record[name]).all(), name


def test_a_light_on_a_node_without_size_shines_somewhere():
    record = packed(Light("directional", node=1), np.diag((0.0, 0.0, 0.0, 1.0)))
    assert np.linalg.norm(record["direction"]) == 1.0


def test_range_and_cutoff_are_squares_of_distances():
    record = packed(Light("point", node=1, range=4.0, intensity=9.0), cutoff=0.25)
    assert record["inverse_range2"] == 1 / 16
    assert record["end_distance2"] == pytest.approx(36.0)
    sun = packed(Light("directional", node=1, range=4.0, intensity=9.0), cutoff=0.25)
    assert sun["inverse_range2"] == 0.0, "the sun has no range"
    assert sun["end_distance2"] > 1e37


def test_cutoff_is_where_the_brightest_colour_falls_below():
    light = Light("point", node=0, intensity=8.0, color=(0.1, 0.5, 0.25))
    distance = cutoff_distance(light, 2.0, 0.02)
    assert 8.0 * 0.5 * 2.0 / distance**2 == pytest.approx(0.02)
    assert cutoff_distance(light, 2.0, 0.0) == math.inf
    assert cutoff_distance(replace(light, kind="directional"), 2.0, 0.02) == math.inf


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
