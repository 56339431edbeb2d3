"""The truths of fog: the bench's quadrature against that of the tests, brute sums of shadows, and path tracing."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from chapters.ch10.benches.fog_truth import FogTruth, Rays, eye_rays
from chapters.ch10.clusters.lights import LightRecords
from tests.support.fog import HAZE, LAYERS, VIEW, foggy, in_cube, lights_of, twin_of
from tests.support.shadows import point, spot, sun
from tests.twins import fog as twin

pytestmark = [pytest.mark.feature("tools/bench"), pytest.mark.runs_on("vulkan", "gl")]

LAMP = point((-1.2, 3.0, 0.8), candela=60.0)
EDGE = 2.0
"""Of the cube of shadows around (0, 1, 0); rays may go through it."""


def rays_of(scene, count=60, seed=4):
    """Return rays from the eye into the yard, relative to the scene's origin."""
    rng = np.random.default_rng(seed)
    ways = rng.uniform((-2.5, 0.0, -2.5), (2.5, 2.0, 2.5), (count, 3)) - VIEW.world_from_view[:3, 3]
    lengths = np.linalg.norm(ways, axis=1) * rng.uniform(0.7, 1.5, count)
    eye = np.broadcast_to(VIEW.world_from_view[:3, 3] - scene.origin, ways.shape)
    return Rays(eye, ways / np.linalg.norm(ways, axis=1)[:, None], lengths)


@pytest.mark.parametrize("g", [0.0, 0.6, -0.5])
@pytest.mark.parametrize("medium", [HAZE, replace(LAYERS, boxes=()), LAYERS], ids=["haze", "height", "box"])
def test_two_quadratures_agree(medium, g):
    """Kinks of the lamp's way behind a box are in no panel's end: they leave some 1e-4 in both."""
    scene = foggy(LAMP, medium=medium)
    rays = rays_of(scene)
    truth = FogTruth(scene, medium, lights_of(scene, LightRecords), g)
    lamp = twin.Light(tuple(LAMP[1][:3, 3]), (60.0,) * 3)
    light, seen = twin.single_scattering(
        rays.origins + scene.origin, rays.directions, rays.lengths, twin_of(medium), lamp, g, 24, 32
    )
    assert np.allclose(truth.light(rays), light, rtol=1e-3 if medium.boxes else 1e-6)
    assert np.allclose(truth.transmittance(rays), seen, rtol=1e-9)


def test_light_from_everywhere_is_a_closed_form():
    scene = foggy(medium=HAZE)
    rays = rays_of(scene)
    truth = FogTruth(scene, HAZE, lights_of(scene, LightRecords), 0.6, ambient=5.0)
    light = 5.0 * -np.expm1(-HAZE.extinction * rays.lengths)[:, None] * np.array(HAZE.albedo)
    assert np.allclose(truth.light(rays), light, rtol=1e-9)


@pytest.mark.parametrize(
    "light",
    [
        LAMP,
        spot((1.5, 4.0, 1.0), (0.0, 0.5, 0.0), outer=0.5),
        sun((0.4, -0.8, 0.3)),
        point((2, 3, 1), reach=4),
    ],
    ids=["point", "spot", "sun", "reach"],
)
def test_shadows_are_those_of_a_brute_sum(light):
    """Of 20,000 midpoints, each of which asks whether the cube is in its way."""
    scene = foggy(light, medium=HAZE)
    rays = rays_of(scene, 12)
    records = lights_of(scene, LightRecords)
    found = FogTruth(scene, HAZE, records, 0.6, blocked=in_cube(scene, EDGE)).light(rays)
    open_ = FogTruth(scene, HAZE, records, 0.6).light(rays)
    assert ((found < 0.98 * open_).any(axis=1).sum()) >= 3  # rays go through the shadow
    (record,) = records
    position, travels = record["position"].astype(np.float64), record["direction"].astype(np.float64)
    color, cone = record["color"].astype(np.float64), record["cone"].astype(np.float64)
    at = (np.arange(20_000) + 0.5) / 20_000
    for way, length, eye, got in zip(rays.directions, rays.lengths, rays.origins, found, strict=True):
        points = eye + at[:, None] * length * way
        if record["kind"] == 2:
            size = (scene.bounds[1] - scene.bounds[0]) / 2
            metres = np.maximum(((size + points * np.sign(travels)) / np.abs(travels)).min(axis=1), 0)
            arrives, received, ends = travels[None], np.ones(len(points)), points - 100 * travels
        else:
            away = points - position
            metres = np.linalg.norm(away, axis=1)
            arrives, ends = away / metres[:, None], np.broadcast_to(position, points.shape)
            window = np.clip(1 - (metres**2 * float(record["inverse_range2"])) ** 2, 0, 1)
            received = window / metres**2
            if record["kind"] == 1:
                received *= np.clip(arrives @ travels * cone[0] + cone[1], 0, 1) ** 2
        turned = 1 + arrives @ way
        strength = received * twin.henyey_greenstein(turned, 0.6) * ~in_cube(scene, EDGE)(points, ends)
        strength *= np.exp(-HAZE.extinction * (metres + at * length)) * HAZE.extinction * length / len(at)
        truth = strength.sum() * color * HAZE.albedo
        assert np.allclose(got, truth, rtol=3e-3, atol=3e-4 * open_.max())


def test_rays_of_pixels_end_at_their_surfaces():
    """Of a depth buffer: near over the distance along the axis, and 0 where nothing was drawn."""
    scene = foggy()
    depth = np.zeros((4, 6))
    depth[1, 2] = VIEW.projection.near / 3.0
    rays = eye_rays(scene, VIEW, depth, np.array([8, 9]), 20.0)
    axis = -VIEW.world_from_view[:3, 2]
    assert np.allclose((rays.directions @ axis) * rays.lengths, (3.0, 20.0))
    seen = rays.at(rays.lengths[:, None])[:, 0] + scene.origin
    clip = np.c_[seen, np.ones(2)] @ VIEW.clip_from_world(6 / 4).T
    pixels = (clip[:, :2] / clip[:, 3:] * 0.5 + 0.5) * (6, 4)
    assert np.allclose(pixels, [(2.5, 1.5), (3.5, 1.5)])
