"""Animation from file to pose: the three interpolations, rotations, ends and loops, clips beside each other."""

from __future__ import annotations

import math

import numpy as np
import pytest

from common.gltf import load_scene
from common.scene import Scene
from common.scene.animation import sample
from common.scene.pose import evaluate_pose
from tests.common.gltf.builder import Gltf, triangle
from tests.common.gltf.test_nodes import rotation_of

RNG = np.random.default_rng(21)
TIMES = [0.5, 1.0, 3.0, 4.0]
KEYS = RNG.normal(size=(4, 3)).astype("f4")


def channel(gltf: Gltf, times, values, path: str, node: int = 0, **more: object) -> int:
    """Add a clip with one channel; returns its number."""
    sampler = {"input": gltf.accessor(times, "f4"), "output": gltf.accessor(values, "f4")}
    if "interpolation" in more:
        sampler["interpolation"] = more.pop("interpolation")
    target = {"node": node, "path": path}
    return gltf.add(
        "animations", {"samplers": [sampler], "channels": [{"sampler": 0, "target": target}], **more}
    )


def moved(scene: Scene, time: float) -> np.ndarray:
    return evaluate_pose(scene, time).world_from_node[0]


def animated(tmp_path, values, path="translation", times=TIMES, **more) -> Scene:
    gltf = triangle()
    channel(gltf, times, values, path, **more)
    scene = load_scene(gltf.write(tmp_path))
    assert scene.warnings == []
    return scene


def test_linear(tmp_path):
    scene = animated(tmp_path, KEYS)
    assert scene.animations[0].duration == 4.0 and scene.animations[0].channels[0].interpolation == "linear"
    for time in np.linspace(0.0, 3.999, 60):
        expected = [np.interp(time, TIMES, KEYS[:, axis]) for axis in range(3)]
        np.testing.assert_allclose(moved(scene, time)[:3, 3], expected, atol=1e-12)


def test_step(tmp_path):
    scene = animated(tmp_path, KEYS, interpolation="STEP")
    for time, key in ((0.0, 0), (0.5, 0), (0.99, 0), (1.0, 1), (2.99, 1), (3.0, 2), (3.99, 2)):
        assert np.array_equal(moved(scene, time)[:3, 3], KEYS[key])


def test_cubic_spline_reproduces_a_cubic(tmp_path):
    """A Hermite spline with the tangents of a cubic is that cubic, whatever the spacing of its keys."""
    coefficients = RNG.normal(size=(4, 3))
    powers = np.array(TIMES)[:, None] ** np.arange(4)
    values = powers @ coefficients
    slopes = (np.array(TIMES)[:, None] ** np.array((0, 0, 1, 2)) * np.arange(4)) @ coefficients
    keys = np.stack([slopes, values, slopes], axis=1).reshape(-1, 3)
    scene = animated(tmp_path, keys, interpolation="CUBICSPLINE")
    for time in np.linspace(0.5, 3.999, 40):
        expected = time ** np.arange(4) @ coefficients
        np.testing.assert_allclose(moved(scene, time)[:3, 3], expected, rtol=2e-6, atol=2e-5)
    assert np.allclose(moved(scene, 0.1)[:3, 3], values[0], atol=1e-6)


def test_tangents_in_and_out_are_not_exchanged(tmp_path):
    keys = np.zeros((2, 3, 3), "f4")
    keys[0, 2, 0] = 1.0  # leaves key 0 with speed 1; everything else stands still
    scene = animated(tmp_path, keys.reshape(-1, 3), times=[0.0, 2.0], interpolation="CUBICSPLINE")
    u = 0.25
    assert moved(scene, 0.5)[0, 3] == pytest.approx((u**3 - 2 * u**2 + u) * 2.0, rel=1e-12)


def turn(axis, angle: float) -> np.ndarray:
    return np.array([*(math.sin(angle / 2) * np.array(axis)), math.cos(angle / 2)])


@pytest.mark.parametrize("sign", [1, -1])
def test_rotations_take_the_short_way_at_constant_speed(tmp_path, sign):
    keys = np.stack([turn((0, 0, 1), 0.4), sign * turn((0, 0, 1), 2.4)])
    scene = animated(tmp_path, keys, "rotation", times=[0.0, 1.0])
    for u in (0.0, 0.1, 0.5, 0.9):
        expected = rotation_of(turn((0, 0, 1), 0.4 + 2.0 * u))
        np.testing.assert_allclose(moved(scene, u)[:3, :3], expected, atol=1e-6)


def test_rotations_of_every_interpolation_stay_rigid(tmp_path):
    quaternions = RNG.normal(size=(4, 4))
    cubic = RNG.normal(size=(12, 4))
    for number, (values, how) in enumerate(
        ((quaternions, "LINEAR"), (quaternions, "STEP"), (cubic, "CUBICSPLINE"))
    ):
        folder = tmp_path / str(number)
        folder.mkdir()
        scene = animated(folder, values, "rotation", interpolation=how)
        for time in np.linspace(0.0, 4.0, 23):
            matrix = moved(scene, time)[:3, :3]
            np.testing.assert_allclose(matrix @ matrix.T, np.eye(3), atol=1e-6)


@pytest.mark.parametrize("coded", ["i1", "i2"])
def test_normalised_integers_as_rotations(tmp_path, coded):
    top = np.iinfo(coded).max
    stored = np.round(np.stack([turn((1, 0, 0), 0.3), turn((1, 0, 0), 1.1)]) * top)
    gltf = triangle()
    output = gltf.accessor(stored, coded, normalized=True)
    sampler = {"input": gltf.accessor([0.0, 1.0], "f4"), "output": output}
    entry = {"sampler": 0, "target": {"node": 0, "path": "rotation"}}
    gltf.add("animations", {"samplers": [sampler], "channels": [entry]})
    scene = load_scene(gltf.write(tmp_path))
    np.testing.assert_allclose(moved(scene, 0.5)[:3, :3], rotation_of(turn((1, 0, 0), 0.7)), atol=1.5 / top)


def test_scale_and_ends_and_loop(tmp_path):
    scene = animated(tmp_path, [(1, 1, 1), (3, 1, 1)], "scale", times=[1.0, 2.0])
    for time, size in ((0.0, 1), (1.0, 1), (1.5, 2), (1.75, 2.5), (2.0, 1), (3.5, 2), (-0.5, 2), (201.5, 2)):
        assert moved(scene, time)[0, 0] == pytest.approx(size, rel=1e-9), time


def test_one_key_holds_for_ever(tmp_path):
    for how, values in (("LINEAR", KEYS[:1]), ("STEP", KEYS[:1]), ("CUBICSPLINE", KEYS[:3])):
        scene = animated(tmp_path, values, times=[0.0], interpolation=how)
        expected = values[1] if how == "CUBICSPLINE" else values[0]
        assert np.array_equal(moved(scene, 17.0)[:3, 3], expected)


def test_two_keys_at_one_time_are_a_jump(tmp_path):
    scene = animated(tmp_path, [(0, 0, 0), (1, 0, 0), (5, 0, 0), (6, 0, 0)], times=[0.0, 1.0, 1.0, 2.0])
    assert [moved(scene, time)[0, 3] for time in (0.5, 1.0, 1.5)] == [0.5, 5.0, 5.5]


def test_clips_for_different_nodes_play_together_and_alternatives_do_not(tmp_path):
    gltf = triangle()
    gltf.node()
    for node, value, name in ((0, 1, "walk"), (1, 2, "wave"), (0, 3, "run")):
        channel(gltf, [0.0], [(value, 0, 0)], "translation", node=node, name=name)
    scene = load_scene(gltf.write(tmp_path))
    assert [clip.name for clip in scene.animations] == ["walk", "wave", "run"]
    assert evaluate_pose(scene, 0.0).world_from_node[:, 0, 3].tolist() == [1, 2]


def test_channels_with_one_set_of_keys_are_sampled_together(tmp_path):
    gltf = triangle()
    nodes = [gltf.node() for _ in range(30)]
    times = gltf.accessor(TIMES, "f4")
    samplers, channels = [], []
    for number, node in enumerate(nodes):
        samplers.append({"input": times, "output": gltf.accessor(KEYS + np.float32(number))})
        channels.append({"sampler": number, "target": {"node": node, "path": "translation"}})
    gltf.add("animations", {"samplers": samplers, "channels": channels})
    scene = load_scene(gltf.write(tmp_path))
    assert len(scene.tracks) == 1
    np.testing.assert_allclose(
        sample(scene.tracks[0], 2.0), (KEYS[1] + KEYS[2]) / 2 + np.arange(30)[:, None], atol=1e-5
    )


def test_what_is_left_out_is_said(tmp_path):
    gltf = triangle()
    gltf.json["nodes"][0]["matrix"] = np.eye(4).ravel().tolist()
    channel(gltf, [0.0], KEYS[:1], "translation")
    channel(gltf, [0.0], [0.5], "weights")
    gltf.json["animations"].append({"samplers": [], "channels": []})
    scene = load_scene(gltf.write(tmp_path))
    assert scene.animations == []
    assert [text.split(" ", 1)[1] for text in scene.warnings] == [
        "moves nodes[0], which has a matrix, and was left out.",
        "drives weights of nodes[0], which has no morph target, and was left out.",
    ]


def test_without_animation_the_pose_is_the_same_object(tmp_path):
    scene = load_scene(triangle().write(tmp_path))
    assert evaluate_pose(scene, 0.0).world_from_object is evaluate_pose(scene, 1.0).world_from_object
    with scene.edit() as edit:
        edit.set_transform(0, translation=(1, 0, 0))
    assert evaluate_pose(scene, 1.0).world_from_object[0, 0, 3] == 1


def test_the_animated_cube_turns_once(models):
    scene = load_scene(models / "AnimatedCube" / "AnimatedCube.gltf")
    start, half = (evaluate_pose(scene, time).world_from_object[0, :3, :3] for time in (0.0, 1.0))
    assert scene.animations[0].duration == 2.0
    np.testing.assert_allclose(start, np.eye(3), atol=1e-6)
    np.testing.assert_allclose(half, np.diag((-1, 1, -1)), atol=1e-6)
