"""Rays of the picture on both backends, against float64: perspective and orthographic, shifted, near and far away."""

from __future__ import annotations

import numpy as np
import pytest

from common.numerics.transforms import orthographic, perspective, pose_looking_at
from tests.support.either import evaluate
from tests.twins import rays as twin

cameras = pytest.mark.feature("ray-tracing/camera-rays")
RESULTS = {"origin": "vec3", "direction": "vec3"}
LENSES = {
    "perspective": perspective(1.0, 1.6, 0.1),
    "narrow": perspective(0.05, 0.5, 2.0),
    "wide": perspective(2.6, 2.0, 1e-3),
    "orthographic": orthographic(3.0, 1.5, 0.05, 120.0),
}
PLACES = [(0.0, 0.0, 0.0), (5.0, 2.0, -3.0), (1000.0, -2000.0, 500.0), (1e5, 2e4, -6e4)]


def text(matrix):
    return "mat4(" + ", ".join(repr(float(number)) for number in np.float32(matrix).T.reshape(-1)) + ")"


def places_in_the_picture():
    grid = np.stack(np.meshgrid(np.linspace(0, 1, 33), np.linspace(0, 1, 17)), axis=-1).reshape(-1, 2)
    return np.float32(np.concatenate([grid, np.random.default_rng(1).uniform(-0.01, 1.01, (1000, 2))]))


@cameras
@pytest.mark.parametrize("eye", PLACES)
@pytest.mark.parametrize("name", LENSES)
def test_directions_are_those_of_float64(either_device, name, eye):
    lens = LENSES[name].copy()
    lens[:2] += np.outer((0.013, -0.021), lens[3])  # a jitter
    pose = pose_looking_at(eye, np.add(eye, (1.0, -0.3, 0.7)))
    view_from_clip, flat = np.linalg.inv(lens), name == "orthographic"
    uv = places_in_the_picture()
    body = f"""
        CameraRay ray = camera_ray(uv, {text(view_from_clip)}, {text(pose)}, {str(flat).lower()});
        origin = ray.origin;
        direction = ray.direction;
    """
    got = evaluate(either_device, ["camera_ray.glsl"], body, {"uv": uv}, RESULTS)
    at_rest = pose.copy()
    at_rest[:3, 3] = 0.0  # the twin divides in the world: without the place, that costs float64 nothing
    origin, direction = twin.camera_ray(uv, view_from_clip, at_rest, flat)
    assert np.abs(got["direction"] - direction).max() < 1e-6
    assert np.abs(np.linalg.norm(got["direction"], axis=1) - 1).max() < 3e-7
    where = np.asarray(eye) + (origin if flat else 0.0)
    # The near plane of an orthographic view is a difference of numbers as large as its far plane.
    assert np.abs(got["origin"] - where).max() <= 2.0**-22 * (np.abs(eye).max() + 120 * flat)


@cameras
def test_the_text_s_direction_is_degrees_off(either_device):
    """The text takes (x, y, 1, 1) through the inverse of the product and normalises all four numbers: what it calls a
    direction is a point relative to the origin, right for an eye there alone. Ours keeps the eye out of it."""
    eye = (5.0, 2.0, -3.0)
    pose = pose_looking_at(eye, (0.0, 0.0, 0.0))
    near, far = 0.1, 100.0
    # Its projection has a finite far plane at depth 1, so that the point is one of the far plane.
    lens = perspective(1.0, 1.6, near)
    finite = lens.copy()
    finite[2, 2], finite[2, 3] = far / (near - far), near * far / (near - far)
    uv = places_in_the_picture()
    _, direction = twin.camera_ray(uv, np.linalg.inv(lens), pose, False)
    clip = np.column_stack([2 * uv - 1, np.ones((len(uv), 2))])
    wrong = clip @ np.linalg.inv(finite @ np.linalg.inv(pose)).T
    wrong /= np.linalg.norm(wrong, axis=1, keepdims=True)
    degrees = np.degrees(np.arccos(np.clip((wrong[:, :3] * direction).sum(axis=1), -1, 1)))
    assert degrees.max() > 1.0
    body = f"direction = camera_ray(uv, {text(np.linalg.inv(lens))}, {text(pose)}, false).direction;"
    got = evaluate(either_device, ["camera_ray.glsl"], body, {"uv": uv}, {"direction": "vec3"})["direction"]
    assert not np.abs(got - wrong[:, :3]).max() < 1e-2
    assert np.abs(got - direction).max() < 1e-6
