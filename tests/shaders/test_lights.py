"""Punctual lights of `shaders/lights.glsl` against glTF's definition (KHR_lights_punctual) in float64."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tests.support.gpu_functions import evaluate
from tests.twins import shading

POINT, SPOT, DIRECTIONAL = 0, 1, 2
ENDLESS = float(np.finfo(np.float32).max)
BODY = """
    Light light = Light(light_position, kind, axis, inverse_range2, color, end_distance2, vec4(cone, 0.0, 0.0));
    received = illuminance(light, position, smallest2, to_light);
"""


def lit(device, **given):
    """Return illuminance and direction to the light, both (N, 3). The default is a point light of 1 cd at zero."""
    count = max(len(value) for value in given.values() if np.ndim(value))
    shapes = {
        "light_position": (0.0, 0.0, 0.0),
        "axis": (0.0, 0.0, -1.0),
        "color": (1.0, 1.0, 1.0),
        "position": (0.0, 0.0, -1.0),
        "cone": (0.0, 0.0),
        "inverse_range2": 0.0,
        "end_distance2": ENDLESS,
        "smallest2": 0.0,
    }
    inputs = {}
    for name, default in shapes.items():
        value = np.asarray(given.get(name, default), np.float32)
        inputs[name] = np.broadcast_to(value, (count, *np.shape(default))).copy()
    inputs["kind"] = np.full(count, given.get("kind", POINT), np.uint32)
    outputs = {"received": "vec3", "to_light": "vec3"}
    got = evaluate(device, ["lights.glsl"], BODY, inputs, outputs)
    return got["received"], got["to_light"]


def around(count, distances, seed=6):
    """Return float32 positions (count, 3) at `distances` (count,) in random directions."""
    away = np.random.default_rng(seed).normal(size=(count, 3))
    return np.float32(away / np.linalg.norm(away, axis=1, keepdims=True) * np.asarray(distances)[:, None])


def test_candela_become_lux_by_the_square_of_the_distance(vulkan_device):
    """1 cd at 1 m is 1 lux; nine decades of distance, a colour per channel."""
    distances = np.geomspace(1e-4, 1e5, 4000)
    positions = around(4000, distances)
    received, to_light = lit(vulkan_device, position=positions, color=(1.0, 10.0, 0.25))
    exact = np.linalg.norm(positions.astype(np.float64), axis=1)
    assert np.allclose(received, np.array((1.0, 10.0, 0.25)) / exact[:, None] ** 2, rtol=1e-6)
    assert np.allclose(to_light, -positions / exact[:, None], atol=3e-7)
    one, _ = lit(vulkan_device, position=[(0.0, 0.0, -1.0)])
    assert one.tolist() == [[1.0, 1.0, 1.0]]


@pytest.mark.parametrize("reach", [0.5, 7.0, 3000.0])
def test_the_range_takes_a_light_to_zero_there_and_not_before(vulkan_device, reach):
    distances = np.concatenate([np.linspace(0.01, 0.999, 2000), [1.0, 1.0001, 1.5, 100.0]]) * reach
    positions = around(len(distances), distances)
    received, _ = lit(vulkan_device, position=positions, inverse_range2=1.0 / reach**2)
    exact = np.linalg.norm(positions.astype(np.float64), axis=1)
    truth = shading.range_window(exact, reach) / exact**2
    # 1 - x^4 cancels near the range: absolute against the light without a window.
    assert (np.abs(received[:, 0] - truth) <= 5e-7 / exact**2).all()
    assert (received[exact < 0.999 * reach] > 0).all()
    assert not received[exact > 1.00005 * reach].any()


def test_an_unlimited_range_has_no_window(vulkan_device):
    positions = around(100, np.geomspace(1.0, 1e9, 100))
    received, _ = lit(vulkan_device, position=positions)
    assert np.allclose(
        received[:, 0] * np.linalg.norm(positions.astype(np.float64), axis=1) ** 2, 1.0, rtol=1e-6
    )


@pytest.mark.parametrize(
    ("inner", "outer"), [(0.0, math.pi / 4), (0.3, 0.5), (0.0, math.pi / 2), (0.4, 0.4001)]
)
def test_the_cone_is_full_inside_and_nothing_outside(vulkan_device, inner, outer):
    """Angles through the whole half turn, every degree many times and both edges: the square of a clamped line."""
    angles = np.concatenate([np.linspace(0, math.pi, 5000), [inner, outer]])
    positions = (
        np.stack([np.sin(angles), np.zeros_like(angles), -np.cos(angles)], axis=1).astype(np.float32) * 2
    )
    scale = 1.0 / max(0.001, math.cos(inner) - math.cos(outer))
    cone = np.float32((scale, -math.cos(outer) * scale))
    received, _ = lit(vulkan_device, kind=SPOT, position=positions, cone=cone, color=(4.0, 4.0, 4.0))
    exact = positions.astype(np.float64)
    cosine = -exact[:, 2] / np.linalg.norm(exact, axis=1)
    # A cosine is 1e-7 coarse, and the line through the edges multiplies that by its slope, twice for the square.
    assert np.abs(received[:, 0] - shading.spot_cone(cosine, inner, outer)).max() <= 2e-6 + 6e-7 * scale
    assert not received[angles > outer + 1e-3].any()
    assert np.allclose(received[cosine > math.cos(outer) + 1.0 / scale + 1e-6, 0], 1.0, rtol=2e-6)


def test_the_cone_follows_the_axis(vulkan_device):
    """On the axis of any direction there is all the light, against it none."""
    axis = around(500, np.ones(500))
    cone = (1.0, 0.0)
    on, _ = lit(vulkan_device, kind=SPOT, axis=axis, position=axis, cone=cone)
    against, _ = lit(vulkan_device, kind=SPOT, axis=axis, position=-axis, cone=cone)
    assert np.allclose(on, 1.0, rtol=2e-6)
    assert not against.any()


def test_a_directional_light_is_the_same_everywhere(vulkan_device):
    """Lux in, lux out: no distance, range, cone or cutoff enters, and the direction to it is against its own."""
    positions = around(200, np.geomspace(1e-3, 1e6, 200))
    axis = around(200, np.ones(200), seed=9)
    received, to_light = lit(
        vulkan_device,
        kind=DIRECTIONAL,
        position=positions,
        axis=axis,
        color=(3.0, 0.5, 0.0),
        inverse_range2=1.0,
        end_distance2=1e-6,
    )
    assert np.array_equal(received, np.tile(np.float32((3.0, 0.5, 0.0)), (200, 1)))
    assert np.array_equal(to_light, -axis)


def test_the_cutoff_ends_a_light_and_changes_nothing_before(vulkan_device):
    distances = np.linspace(0.1, 4.0, 500)
    positions = around(500, distances)
    plain, _ = lit(vulkan_device, position=positions)
    ended, _ = lit(vulkan_device, position=positions, end_distance2=4.0)
    inside = np.linalg.norm(positions.astype(np.float64), axis=1) < 2.0
    assert np.array_equal(ended[inside], plain[inside])
    assert not ended[~inside].any()


def test_a_point_at_the_light_itself_is_bright_but_finite(vulkan_device):
    """Nearer than `smallest2` distances are not told apart; the direction may vanish, but it is never a NaN."""
    positions = [(0.0, 0.0, 0.0), (1e-30, 0.0, 0.0), (1e-12, 0.0, 0.0), (1e-7, 1e-7, 0.0)]
    for kind in (POINT, SPOT):
        received, to_light = lit(
            vulkan_device, kind=kind, position=positions, smallest2=1e-12, cone=(1.0, 1.0)
        )
        assert np.isfinite(received).all()
        assert np.isfinite(to_light).all()
        assert received.max() <= 1.0001e12
        assert np.linalg.norm(to_light, axis=1).max() < 1.000001
