"""Directions of panoramas and cube maps: `shaders/environment.glsl` against float64, and float64 against geometry."""

from __future__ import annotations

import numpy as np
import pytest

from common.environment import directions
from tests.support.gpu_functions import evaluate

NAMED = {"right": (1, 0, 0), "left": (-1, 0, 0), "up": (0, 1, 0), "down": (0, -1, 0), "ahead": (0, 0, -1)}


def scattered(count=20_000):
    """Return float32 directions of many lengths: anywhere, near the poles, on edges and corners of the cube."""
    rng = np.random.default_rng(3)
    d = rng.normal(size=(count, 3))
    d[: count // 4, [0, 2]] *= 10.0 ** rng.uniform(-6, -1, (count // 4, 1))
    d[count // 4 : count // 3] = rng.choice([-1.0, -0.5, 0.5, 1.0], (count // 3 - count // 4, 3))
    return np.float32(np.concatenate([d, list(NAMED.values()), [(0, 0, 1)]]))


def test_panorama_on_the_device(vulkan_device):
    d = scattered()
    got = evaluate(
        vulkan_device,
        ["environment.glsl"],
        "uv = panorama_uv(d); back = panorama_direction(uv);",
        {"d": d},
        {"uv": "vec2", "back": "vec3"},
    )
    truth = directions.panorama_uv(d)
    apart = np.abs(got["uv"] - truth)
    apart[:, 0] = np.minimum(apart[:, 0], 1 - apart[:, 0])  # -pi and pi are one meridian
    unit = d / np.linalg.norm(d.astype(np.float64), axis=1, keepdims=True)
    assert apart.max() < 2e-6  # of the panorama's width: a tenth of a pixel of 64k
    assert np.abs(got["back"] - unit).max() < 2e-5


def test_cube_on_the_device(vulkan_device):
    d = scattered()
    body = """
        uint f;
        uv = cube_uv(d, f);
        face = f;
        back = cube_direction(f, uv);
        angle = cube_texel_solid_angle(normalize(d), 8.0);
    """
    outputs = {"uv": "vec2", "face": "uint", "back": "vec3", "angle": "float"}
    got = evaluate(vulkan_device, ["environment.glsl"], body, {"d": d}, outputs)
    face, uv = directions.cube_uv(d)
    assert np.array_equal(got["face"], face)
    assert np.abs(got["uv"] - uv).max() < 2e-7
    largest = np.abs(d).max(axis=1, keepdims=True)
    assert np.abs(got["back"] - d / largest).max() < 1e-6
    unit = d / np.linalg.norm(d.astype(np.float64), axis=1, keepdims=True)
    assert np.allclose(got["angle"], 4 * np.abs(unit).max(axis=1) ** 3 / 64, rtol=1e-5)


def test_turning_on_the_device(vulkan_device):
    d = scattered(500)
    cos_sin = np.tile(np.float32([np.cos(0.7), np.sin(0.7)]), (len(d), 1))
    inputs = {"d": d, "cs": cos_sin}
    got = evaluate(vulkan_device, ["environment.glsl"], "e = turned_back(d, cs);", inputs, {"e": "vec3"})
    assert np.allclose(got["e"], directions.turn_back(d, 0.7), rtol=0, atol=3e-6)


@pytest.mark.parametrize(
    ("name", "uv"), [("ahead", (0.5, 0.5)), ("right", (0.75, 0.5)), ("left", (0.25, 0.5)), ("down", (0.5, 1))]
)
def test_panorama_is_seen_from_inside(name, uv):
    assert np.allclose(directions.panorama_uv(NAMED[name]), uv)
    assert np.allclose(directions.panorama_direction(uv), NAMED[name])


def test_float64_inverses_and_solid_angles():
    d = scattered(4000).astype(np.float64)
    d /= np.linalg.norm(d, axis=1, keepdims=True)
    assert np.abs(directions.panorama_direction(directions.panorama_uv(d)) - d).max() < 1e-15 * 10
    face, uv = directions.cube_uv(d)
    back = directions.cube_direction(face, uv)
    assert np.abs(back / np.linalg.norm(back, axis=1, keepdims=True) - d).max() < 1e-15 * 10
    assert uv.min() >= 0 and uv.max() <= 1
    for size in (1, 2, 7, 64):
        assert np.isclose(6 * directions.cube_solid_angles(size).sum(), 4 * np.pi, rtol=1e-12)
    assert np.isclose(directions.panorama_solid_angles(9).sum() * 18, 4 * np.pi, rtol=1e-14)
    # The shader's midpoint rule against the exact angles, worst in the corners of a coarse cube.
    centres = directions.cube_directions(16)[0]
    midpoint = 4 * np.abs(centres).max(axis=-1) ** 3 / 16**2
    assert np.abs(midpoint / directions.cube_solid_angles(16) - 1).max() < 0.004


def test_a_turned_environment_is_seen_at_the_direction_before_the_turn():
    # A quarter turn counter-clockwise seen from above takes what was on the right (+x) to ahead (-z).
    assert np.allclose(directions.turn_back((0, 0, -1), np.pi / 2), (1, 0, 0))
