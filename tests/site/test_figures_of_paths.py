"""The figures of paths are true: rays that are blocked, densities of lobes, and errors with their slopes."""

from __future__ import annotations

import numpy as np
import pytest

from tests.twins import ggx_sampling, shading
from tools.site.figures.ch12 import lobes, paths, samples


def test_rays_to_the_lamp_arrive_where_nothing_is_in_the_way():
    """Points along each ray are inside of no block if and only if it arrives; walls are outside of the box."""

    def inside(points):
        return any(
            (
                (points[:, 0] > x)
                & (points[:, 0] < x + wide)
                & (points[:, 1] > y)
                & (points[:, 1] < y + tall)
            ).any()
            for x, y, wide, tall in paths.BLOCKS
        )

    found = paths.traced()
    assert [len(path.points) - 1 - (not path.ended) for path in found] == [
        len(path.to_lamp) for path in found
    ]
    assert {path.ended for path in found} == {True, False}
    arrived = []
    for path in found:
        for place, (end, arrives) in zip(path.points[1:], path.to_lamp, strict=False):
            assert not inside(place + np.linspace(0, 1, 999)[:, None] * (end - place))
            beyond = end + 1e-4 * (end - place)
            assert arrives == (abs(end[1] - paths.LAMP[0][1]) < 1e-9)
            assert arrives or inside(beyond[None])
            arrived.append(arrives)
        for a, b in zip(path.points, path.points[1:], strict=False):
            assert not inside(a + np.linspace(1e-4, 1 - 1e-4, 999)[:, None] * (b - a))
    assert 2 <= arrived.count(False) < len(arrived)


def test_densities_are_those_of_the_material():
    """Values and the mirrored lobe's density by the twins; both lobes' densities integrate to 1 at most."""
    angle = np.linspace(-80.0, 80.0, 33)
    light, view = lobes.towards(angle), lobes.towards(np.array(-lobes.VIEW))
    mirrored, matte, lobe, cosine = lobes.parts(light)
    up, alpha = np.array((0.0, 0.0, 1.0)), lobes.ROUGHNESS**2
    value = shading.metallic_roughness(up, light, view, np.full(3, lobes.BASE), 0.0, alpha)[..., 0]
    assert np.abs(mirrored + matte - value).max() < 1e-6 * value.max()
    half = light + view
    n_dot_h = half[:, 2] / np.linalg.norm(half, axis=1)
    assert np.abs(lobe / ggx_sampling.pdf_ggx(n_dot_h, view[2], alpha) - 1.0).max() < 1e-9
    directions, solid_angle = lobes.hemisphere()
    _, _, lobe, cosine = lobes.parts(directions)
    assert 0.9 < lobe.sum() * solid_angle < 1.0, "some mirrored directions are below the surface"
    assert cosine.sum() * solid_angle == pytest.approx(1.0, abs=1e-5)


def test_errors_fall_as_the_page_says():
    slopes = {
        name: np.polyfit(np.log(samples.COUNTS), np.log(errors), 1)[0]
        for name, errors in samples.errors().items()
    }
    *random, even = samples.NAMES
    assert all(abs(slopes[name] + 0.5) < 0.03 for name in random), slopes
    assert slopes[even] < -0.7
    reflected, lamp, both = (np.array(samples.errors()[name]) for name in random)
    assert (both < reflected).all() and (both < lamp).all()


def test_each_way_has_the_light_of_the_quadrature():
    """In units of the exact irradiance of a square, which is that of form factors (Howell, from a corner)."""

    def corner(a, b):
        x, y = a / np.hypot(a, samples.HEIGHT), b / np.hypot(b, samples.HEIGHT)
        first = x * np.arctan(b / np.hypot(a, samples.HEIGHT))
        return 0.5 * (first + y * np.arctan(a / np.hypot(b, samples.HEIGHT)))

    sides = samples.HALF + samples.BESIDE, samples.HALF - samples.BESIDE
    exact = sum(2.0 * corner(side, samples.HALF) for side in sides)
    assert samples.truth() == pytest.approx(exact, rel=1e-9)
    rng = np.random.default_rng(1)
    lots = rng.random((2, 200_000, 2))
    for way in ("reflected", "lamp", "both"):
        values = samples.light(*lots, way)
        assert abs(values.mean() - exact) < 4.0 * values.std() / np.sqrt(values.size)
