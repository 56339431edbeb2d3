"""The study burley-smith against tabulated colours, a twin in double precision, and sums over environments."""

from __future__ import annotations

import math

import numpy as np
import pytest

from chapters.ch01.studies.burley_smith import BALLS, EVEN, SUN, Settings, irradiance
from common.environment import Environment
from common.environment.directions import panorama_directions
from common.images.color import encode_srgb
from tests.support.bounds import codes_off

FILE = "burley_smith/burley.glsl"
BASE = (0.8, 0.4, 0.2)
TABLE = {  # (roughness, metallic): colour for n = v = z, l = (1, 0, 1) / sqrt 2, one lux
    (0.5, 0.0): (0.170828, 0.087868, 0.046389),
    (0.5, 1.0): (0.098167, 0.049084, 0.024542),
    (1.0, 0.0): (0.169015, 0.085826, 0.044232),
    (1.0, 1.0): (0.052739, 0.026370, 0.013185),
    (0.1, 0.0): (0.165788, 0.082901, 0.041458),
}
BODY = "c = burley_smith(surface_of(base, m, r), n, l, v);"


def twin(
    base: np.ndarray, m: np.ndarray, r: np.ndarray, n: np.ndarray, light: np.ndarray, v: np.ndarray
) -> np.ndarray:
    """Return (N, 3) float64: the terms as the cookbook prints them, GGX with its cancelling denominator."""

    def dot(a, b):
        return (a * b).sum(-1, keepdims=True)

    m, r = m[:, None], r[:, None].clip(0.04, 1)
    a = r * r
    diffuse, f0 = base * 0.96 * (1 - m), 0.04 * (1 - m) + base * m
    h = (light + v) / np.linalg.norm(light + v, axis=-1, keepdims=True)
    nl, nv, nh, vh = dot(n, light), np.abs(dot(n, v)).clip(0.001, 1), dot(n, h), dot(v, h).clip(0, 1)
    f90 = (25 * f0.max(-1, keepdims=True)).clip(0, 1)
    f = f0 + (f90 - f0) * (1 - vh) ** 5
    g = np.prod([2 * x / (x + np.sqrt(a * a + (1 - a * a) * x * x)) for x in (np.abs(nl), nv)], axis=0)
    d = a * a / (math.pi * ((nh * a * a - nh) * nh + 1) ** 2)
    bent = 2 * vh * vh * a - 0.5
    matt = diffuse / math.pi * (1 + bent * (1 - nl) ** 5) * (1 + bent * (1 - nv) ** 5)
    return np.where(nl > 0, nl * ((1 - f) * matt + f * g * d / (4 * nl * nv)), 0.0)


def hemisphere(count: int, seed: int) -> np.ndarray:
    """Return unit vectors (N, 3) with z above 0.02."""
    random = np.random.default_rng(seed)
    z, angle = random.uniform(0.02, 1, count), random.uniform(0, 2 * math.pi, count)
    side = np.sqrt(1 - z * z)
    return np.stack([side * np.cos(angle), side * np.sin(angle), z], axis=-1).astype(np.float32)


@pytest.mark.feature("pbr/burley-smith")
def test_the_tabulated_colours_are_met(stage):
    count = len(TABLE)
    roughness, metallic = (np.array(column, np.float32) for column in zip(*TABLE, strict=True))
    up = np.tile(np.float32((0, 0, 1)), (count, 1))
    light = np.tile((np.array([1, 0, 1]) / math.sqrt(2)).astype(np.float32), (count, 1))
    inputs = {"base": np.tile(np.float32(BASE), (count, 1)), "m": metallic, "r": roughness}
    got = stage.evaluate(FILE, BODY, {**inputs, "n": up, "l": light, "v": up}, {"c": "vec3"})["c"]
    assert np.abs(got - np.array(list(TABLE.values()))).max() < 1e-5


@pytest.mark.feature("pbr/burley-smith")
def test_every_direction_matches_the_twin(stage):
    count = 2000
    random = np.random.default_rng(5)
    inputs = {
        "base": random.uniform(0, 1, (count, 3)).astype(np.float32),
        "m": random.choice([0.0, 0.5, 1.0], count).astype(np.float32),
        "r": random.uniform(0.15, 1.0, count).astype(np.float32),
        "n": np.tile(np.float32((0, 0, 1)), (count, 1)),
        "l": hemisphere(count, 1) * np.where(np.arange(count) % 9 == 0, -1, 1).astype(np.float32)[:, None],
        "v": hemisphere(count, 2),
    }
    got = stage.evaluate(FILE, BODY, inputs, {"c": "vec3"})["c"].astype(np.float64)
    expected = twin(*(array.astype(np.float64) for array in inputs.values()))
    assert (got[::9] == 0).all(), "light from behind"
    assert (np.abs(got - expected) / (expected + 1e-2)).max() < 1e-4
    inputs["r"] = 0.99 * inputs["r"]
    smoother = twin(*(array.astype(np.float64) for array in inputs.values()))
    assert (np.abs(got - smoother) / (smoother + 1e-2)).max() > 1e-2, (
        "a hundredth less of roughness is noticed"
    )


@pytest.mark.feature("ibl/diffuse")
def test_even_light_leaves_a_dielectric_as_its_albedo_in_every_direction(stage):
    """0.96 * albedo * E, whichever way the surface faces, and whatever its roughness; a metal has no matt part."""
    even = irradiance(Environment("even", np.full((64, 128, 3), 0.7, np.float32)))
    assert np.abs(even.radiance - 0.7).max() < 1e-6
    count = 64
    random = np.random.default_rng(8)
    inputs = {
        "base": random.uniform(0, 1, (count, 3)).astype(np.float32),
        "m": (np.arange(count) % 2).astype(np.float32),
        "r": random.uniform(0, 1, count).astype(np.float32),
        "e": even.radiance.reshape(-1, 3)[::8],  # that of 64 normals all around
    }
    body = "c = environment_diffuse(surface_of(base, m, r), e);"
    got = stage.evaluate(FILE, body, inputs, {"c": "vec3"})["c"]
    assert np.abs(got - np.where(inputs["m"][:, None] > 0, 0, 0.96 * inputs["base"] * 0.7)).max() < 1e-6


@pytest.mark.feature("ibl/diffuse")
def test_irradiance_of_a_gradient_is_two_thirds_of_it():
    """Light a + b.d gives a + (2/3) b.n: the cosine keeps the mean, two thirds of what is linear (Ramamoorthi 2001)."""
    slope = np.array([0.3, -0.5, 0.2])
    light = 1.0 + panorama_directions(64) @ slope
    source = Environment("gradient", np.repeat(light[..., None], 3, axis=-1).astype(np.float32))
    expected = 1.0 + 2 / 3 * panorama_directions(16) @ slope
    assert np.abs(irradiance(source).radiance - expected[..., None]).max() < 3e-3
    unweighted = 1.0 + panorama_directions(16) @ slope
    assert np.abs(irradiance(source).radiance - unweighted[..., None]).max() > 0.1, (
        "light that no cosine weighed"
    )


def balls(size: tuple[int, int]) -> tuple[np.ndarray, ...]:
    """Return of each pixel the normal, roughness, metalness, and whether a ball is there, well within its rim."""
    width, height = size
    x = (np.arange(width) + 0.5) / width * BALLS[0]
    y = (np.arange(height) + 0.5) / height * BALLS[1]
    x, y = np.meshgrid(x, y)
    p = np.stack([(x % 1) * 2 - 1, 1 - (y % 1) * 2], axis=-1) / 0.9
    inside = 1 - (p**2).sum(-1)
    normal = np.concatenate([p, np.sqrt(inside.clip(1e-9, None))[..., None]], axis=-1)
    return normal, np.floor(x) / (BALLS[0] - 1), np.floor(y), inside > 0.05


def test_the_picture_of_the_sun_is_that_of_the_formula(stage):
    size = (60, 24)
    picture = stage.draw("burley-smith", size, settings=Settings(show="sun", illuminance=1.0))["color"]
    normal, roughness, metallic, seen = balls(size)
    sharp = roughness < 0.2  # their highlight is smaller than a pixel
    sun = np.broadcast_to(SUN / np.linalg.norm(SUN), (seen.sum(), 3))
    eye = np.broadcast_to((0.0, 0.0, 1.0), sun.shape)
    base = np.broadcast_to(BASE, sun.shape)
    expected = np.zeros((*seen.shape, 3))
    expected[seen] = twin(base, metallic[seen], roughness[seen], normal[seen], sun, eye)
    chosen = seen & ~sharp
    assert (
        np.abs(picture - 255 * encode_srgb(expected.clip(0, 1)))[chosen].max()
        <= codes_off(stage.device) + 0.05
    )
    assert chosen.mean() > 0.4


@pytest.mark.feature("ibl/diffuse")
def test_in_even_light_a_ball_has_one_colour(stage):
    size = (60, 24)
    picture = stage.draw("burley-smith", size, settings=Settings(show="sky", sky="even"))["color"]
    _, _, metallic, seen = balls(size)
    matt = 255 * encode_srgb(0.96 * np.array(BASE) * EVEN)
    assert np.abs(picture[seen & (metallic == 0)] - matt).max() <= codes_off(stage.device) + 0.01
    assert (picture[seen & (metallic == 1)] == 0).all()
