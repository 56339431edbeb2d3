"""What the benches of shadows hold maps to: rays against closed forms, and errors of pictures made by hand."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from chapters.ch08.benches.shadow_truth import AROUND, ShadowTruth, errors_of, illuminances, off_edges
from chapters.ch08.settings import Settings
from chapters.ch08.shadows.faces import FACE
from common.numerics.transforms import pose_looking_at
from common.settings import replaced
from common.view.camera import Orthographic, View
from tests.support.shadows import placed, point, spot, sun, yard
from tests.twins import shadows as twin

pytestmark = pytest.mark.needs("mitsuba")

SIZE = (48, 48)
ABOVE = View(pose_looking_at((0, 6, 0), (0, 0, 0), (0, 0, -1)), Orthographic(3.0, 0.1, 20.0))
LIGHTS = {
    "sun": (sun((0.5, -1.0, 0.3)), None, (-0.5, 1.0, -0.3)),
    "spot": (spot((1.5, 4.0, 1.0), (0.0, 0.5, 0.0), outer=math.radians(55)), (1.5, 4.0, 1.0), None),
    "point": (point((-1.2, 3.0, 0.8)), (-1.2, 3.0, 0.8), None),
}


def truth_of(scene, size=SIZE, view=ABOVE, **turned):
    from chapters.ch08.benches.ray_casting import RayCaster

    return ShadowTruth(scene, view, size, RayCaster(scene), replaced(Settings(), **turned))


@pytest.mark.feature("tools/bench")
@pytest.mark.parametrize("kind", LIGHTS)
def test_a_factor_is_1_where_float64_rays_reach_the_light(kind):
    """All pixels but those whose ray passes an edge within single precision and the lift of rays."""
    light, place, towards = LIGHTS[kind]
    scene = yard(light, extra=(placed((2.0, 1.0, -2.0), (1.5, 1.0), (1.0, 0.4, 0.2)),))
    truth = truth_of(scene)
    found = truth.hard().ravel()[truth.surfaces.pixels]
    points = truth.surfaces.points + 1e-4 * truth.surfaces.flat + scene.origin
    rays = np.broadcast_to(towards, points.shape) if place is None else np.array(place) - points
    nearest = twin.first_hit(points, rays, twin.triangles_of(scene), 1e-6)
    wanted = nearest >= (np.inf if place is None else 1.0)
    known = np.isfinite(found)
    assert known.mean() > 0.7 and 0.02 < 1 - found[known].mean() < 0.7
    assert (found[known] == wanted[known]).mean() > 0.998


@pytest.mark.feature("tools/bench")
def test_what_is_seen_through_pixels_is_the_first_surface():
    truth = truth_of(yard(LIGHTS["point"][0]))
    surfaces = truth.surfaces
    assert len(surfaces.pixels) == SIZE[0] * SIZE[1]
    row, column = np.divmod(surfaces.pixels, SIZE[0])
    world = surfaces.points + yard(LIGHTS["point"][0]).origin
    np.testing.assert_allclose(world[:, 0], (column + 0.5) / SIZE[0] * 6 - 3, atol=1e-9)
    np.testing.assert_allclose(world[:, 2], (row + 0.5) / SIZE[1] * 6 - 3, atol=1e-9)
    on_cube = (np.abs(world[:, [0, 2]]) < 0.5).all(axis=1)
    np.testing.assert_allclose(world[:, 1], np.where(on_cube, 1.5, 0.0), atol=1e-9)
    np.testing.assert_allclose(surfaces.flat, np.tile((0.0, 1.0, 0.0), (len(world), 1)), atol=1e-12)


@pytest.mark.feature("tools/bench")
def test_lights_weigh_by_their_illuminance():
    """Candela over the square of the distance, times the cosine; lux times the cosine."""
    scene = yard(sun((0.0, -1.0, 0.0), lux=3.0), point((0.0, 3.0, 0.0), candela=60.0))
    truth = truth_of(scene)
    light = illuminances(truth.surfaces, truth.records, 1e-9)
    world = truth.surfaces.points + scene.origin
    away = np.linalg.norm(world - (0.0, 3.0, 0.0), axis=1)
    np.testing.assert_allclose(light[:, 0], 3.0, rtol=1e-6)
    np.testing.assert_allclose(light[:, 1], 60.0 / away**2 * (3.0 - world[:, 1]) / away, rtol=1e-5)


@pytest.mark.feature("tools/bench")
def test_a_soft_edge_is_as_wide_as_the_light_makes_it():
    """A half plane at height 2 over a ground under a lamp at height 4: the penumbra is 2 radii wide, and at its middle
    the factor is 1/2. Along it the factor is the part of a disc on one side of a line."""
    radius, rays = 0.4, 256
    scene = yard(point((0.0, 4.0, 0.0)), extra=(placed((-3.0, 2.0, 0.0), (6.0, 12.0), (0.0, 1.0, 0.0)),))
    scene.instances.visible[1:7] = False
    size = (SIZE[0], 4)  # rows in the middle of the same pictures
    strip = replace(ABOVE, projection=Orthographic(3.0 * size[1] / size[0], 0.1, 20.0))
    found = truth_of(scene, size, strip).soft(radius, 0.0, rays)
    x = (np.arange(size[0]) + 0.5) / size[0] * 6 - 3
    row = found[size[1] // 2]
    beyond = np.isfinite(row) & (x > 0.0)  # the others are on the half plane itself
    # From the ground at x the edge x = 0 at height 2 is seen in front of the lamp's plane at x' = -x.
    t = np.clip(x / radius, -1.0, 1.0)
    wanted = 1 - (np.arccos(t) - t * np.sqrt(1 - t * t)) / np.pi
    assert beyond.sum() > 15
    np.testing.assert_allclose(row[beyond], wanted[beyond], atol=0.02)


@pytest.mark.feature("tools/bench")
def test_maps_with_exact_depths_err_by_a_quarter_of_a_texel():
    """The middle of a texel is off by (u, v), each even in -t/2 .. t/2. Across an edge along an axis of the face that
    is t/4 in the mean, along a diagonal sqrt(2)/6 t: so much area is wrong for each length of the edge."""
    size, texel, turned = (96, 96), 1 / 8, math.radians(20.0)
    scene = yard(sun((0.0, -1.0, 0.0)))
    scene.instances.visible[[1, 2, 4, 5, 6]] = False  # the ground and the upper side of the cube are left
    truth = truth_of(scene, size)
    face = np.zeros(1, FACE)
    face["right"], face["down"] = (
        (math.cos(turned), 0, math.sin(turned)),
        (math.sin(turned), 0, -math.cos(turned)),
    )
    face["ahead"], face["size"], face["far"] = (0, -1, 0), 256, 100.0
    face["scale_x"] = face["scale_y"] = 1 / texel
    hard, areas = truth.hard(), []
    assert np.nanmin(hard) == 1.0, (
        "a sun overhead: the square hides its own shadow, but for the errors of its outline"
    )
    for x, z in np.random.default_rng(5).uniform(-texel, texel, (8, 2)):
        face["origin"] = (x, 10.0, z)
        areas.append((truth.exact(face, 1, (0.0, 0.0)) < 0.5).mean() * 36.0)
    u = (np.arange(2000) + 0.5) / 2000 - 0.5
    mean = np.abs(u[:, None] * math.cos(turned) + u * math.sin(turned)).mean() * texel
    assert 0.2357 * texel < mean < 0.25 * texel
    # 4 metres of edge, of whose two sides the picture shows one.
    assert np.mean(areas) == pytest.approx(4.0 * mean / 2, rel=0.1)


@pytest.mark.feature("tools/bench")
def test_errors_of_pictures_made_by_hand():
    truth = np.zeros((20, 20))
    truth[:, 10:] = 1.0
    truth[0, 0] = np.nan
    even = off_edges(truth)
    assert not even[:, 8:12].any() and even[8, 2:8].all() and not even[AROUND, AROUND]
    found = truth.copy()
    assert errors_of(found, truth) == dict.fromkeys(("error", "wrong", "off_edges", "dark", "bright"), 0.0)
    found[5, 15], found[9, 9], found[9, 3] = 0.5, 0.2, 1.0
    errors = errors_of(found, truth)
    assert errors["error"] == pytest.approx(1.7 / 399) and errors["wrong"] == pytest.approx(2 / 399)
    assert errors["dark"] == pytest.approx(1 / even.sum()) == errors["bright"]
    assert errors["off_edges"] == pytest.approx(1.5 / even.sum())
    found[9, 3] = np.nan
    assert errors_of(found, truth)["wrong"] == pytest.approx(1 / 398)
