"""Moved and scaled scenes: what stays, what changes, and by how much."""

from __future__ import annotations

import math

import numpy as np
import pytest

from common.numerics.transforms import pose_looking_at
from common.scene import Light
from common.scene.pose import evaluate_pose
from common.scene.stability import BOUND, FACTORS, OFFSETS_M, cases, moved, pixels_changed, scaled
from common.view.camera import Orthographic, Perspective, View
from tests.support.scenes import quad_scene, translated


def scene_and_view():
    """Return a square and a lamp away from zero, and a camera that sees them."""
    matrices = (translated(1.0, 2.0, 3.0), translated(0.0, 0.0, 5.0))
    lights = (
        Light("point", node=1, intensity=7.0, range=4.0),
        Light("directional", node=1, intensity=2.0),
    )
    scene = quad_scene(matrices=matrices, lights=lights, instance_materials=(0,))
    return scene, View(pose_looking_at((1.0, 2.0, 9.0), (1.0, 2.0, 3.0)), Perspective(0.8, 0.5))


def test_every_node_and_the_camera_move_by_the_same_metres():
    scene, view = scene_and_view()
    offset = np.array((1e5, -3.0, 0.25))
    there, seen = moved(scene, view, tuple(offset))
    before, after = (evaluate_pose(s, 0.0).world_from_node for s in (scene, there))
    count = len(scene.nodes)
    assert np.array_equal(after[:count, :3, 3] - before[:, :3, 3], np.tile(offset, (count, 1)))
    assert np.array_equal(after[:count, :3, :3], before[:, :3, :3])
    assert np.array_equal(seen.eye - view.eye, offset)
    assert np.allclose(there.origin - scene.origin, offset, rtol=0, atol=1e-9)
    assert there.lights == scene.lights


def test_lengths_scale_by_the_factor_and_candelas_by_its_square():
    scene, view = scene_and_view()
    there, seen = scaled(scene, view, 1e3)
    before, after = (evaluate_pose(s, 0.0).world_from_node for s in (scene, there))
    assert np.allclose(after[: len(before), :3, 3], before[:, :3, 3] * 1e3)
    assert math.isclose(there.length_scale, scene.length_scale * 1e3)
    assert np.allclose(seen.eye, view.eye * 1e3)
    assert seen.projection == Perspective(0.8, 500.0)
    lamp, sun = there.lights
    assert (lamp.intensity, lamp.range) == (7e6, 4e3)
    assert sun.intensity == 2.0
    flat, wide = scaled(scene, View(view.world_from_view, Orthographic(2.0, 0.1, 10.0)), 10.0)
    assert flat.lights[0].intensity == pytest.approx(700.0)
    assert wide.projection == Orthographic(20.0, 1.0, 100.0)


def test_the_original_is_left_alone():
    scene, view = scene_and_view()
    nodes = scene.nodes.matrix.copy()
    list(cases(scene, view))
    assert np.array_equal(scene.nodes.matrix, nodes)
    assert len(scene.nodes) == 2


def test_every_case_is_named():
    names = [name for name, _, _ in cases(*scene_and_view())]
    assert len(set(names)) == len(names) == len(OFFSETS_M) + len(FACTORS)
    assert "moved by (100000, 0, 0) m" in names
    assert "scaled by 0.001" in names


def test_pixels_are_counted_that_change_by_more_than_a_step():
    a = np.full((10, 10, 3), 100, np.uint8)
    b = a.copy()
    b[0, 0, 2] += 1  # rounding: allowed
    assert pixels_changed(a, b) == 0.0
    b[0, 1] += 2  # all channels of one pixel count once
    b[9, 9, 0] = 0
    assert pixels_changed(a, b) == pixels_changed(b, a) == 0.02
    assert pixels_changed(a, b, step=0) == 0.03
    assert BOUND < 0.01
