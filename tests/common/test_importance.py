"""Weights of a cube map's texels: luminance times solid angle, of the map as a linear filter shows it."""

from __future__ import annotations

import numpy as np
import pytest

from common.environment.directions import cube_direction, cube_solid_angles, cube_uv
from common.environment.importance import cube_weights

feature = pytest.mark.feature("path-tracer/environment-alias-table")


def gray(values):
    """Return a map (6, n, n, 4) of gray radiance, and 1 in the fourth channel, as maps are stored."""
    return np.concatenate([np.repeat(values[..., None], 3, axis=-1), np.ones((*values.shape, 1))], axis=-1)


@feature
@pytest.mark.parametrize("size", [1, 2, 16])
def test_an_even_sky_weighs_its_solid_angle(size):
    weights = cube_weights(np.full((6, 16, 16, 3), 2.5, np.float16), size)
    assert weights.shape == (6, size, size)
    assert np.isclose(weights.sum(), 4 * np.pi * 2.5, rtol=1e-12)
    assert np.allclose(weights, 2.5 * cube_solid_angles(size), rtol=1e-12)


def test_the_mean_of_the_filtered_texel_counts():
    """Inside a face: against a linear filter at 64 x 64 points of each texel."""
    n, part = 8, 64
    values = np.random.default_rng(4).random((6, n, n))
    weights = cube_weights(gray(values)) / cube_solid_angles(n)
    at = (np.arange(n * part) + 0.5) / part - 0.5
    low = np.clip(np.floor(at).astype(int), 0, n - 2)
    rest = at - low
    rows = values[0][low] * (1 - rest)[:, None] + values[0][low + 1] * rest[:, None]
    filtered = rows[:, low] * (1 - rest) + rows[:, low + 1] * rest
    means = filtered.reshape(n, part, n, part).mean(axis=(1, 3))
    assert np.allclose(weights[0, 1:-1, 1:-1], means[1:-1, 1:-1], rtol=2e-4)


@feature
def test_light_spreads_over_the_edges_of_the_cube():
    """Every texel whose neighbour shines, on whichever face that is, has a weight; all others have none.

    Neighbours are found by directions: half a texel beyond a point of a texel's rim lies the neighbour.
    """
    n = 4
    for face in range(6):
        for row, column in ((0, 0), (0, 1), (3, 2), (1, 3), (2, 0), (3, 3)):
            values = np.zeros((6, n, n))
            values[face, row, column] = 1.0
            weights = cube_weights(gray(values)) / cube_solid_angles(n)
            near = np.zeros((6, n, n), bool)
            steps = np.linspace(-1.0, 2.0, 13)
            uv = (np.array([column, row]) + np.stack(np.meshgrid(steps, steps), -1).reshape(-1, 2)) / n
            # A hair inside, since a texel's own rim belongs to its neighbour.
            middle = (np.array([column, row]) + 0.5) / n
            uv = middle + (uv - middle) * 0.999
            beside = (uv < 0).any(axis=1).astype(int) + (uv > 1).any(axis=1)
            other, there = cube_uv(cube_direction(face, uv))
            place = np.clip((there * n).astype(int), 0, n - 1)
            inside = beside == 0
            near[other[inside], place[inside, 1], place[inside, 0]] = True
            assert (weights[near] > 0).all()
            assert np.isclose(weights[face, row, column], 0.5625, atol=0.09)
            # Over each edge that the texel touches, one texel of the face there has an eighth of three quarters at
            # least.
            touching = (row in (0, n - 1)) + (column in (0, n - 1))
            lit = [f for f in range(6) if f != face and weights[f].max() >= 0.75 * 0.125 - 1e-12]
            assert len(lit) == touching
            assert not weights[face ^ 1].any(), "the opposite face is out of reach"


def test_brighter_colours_weigh_by_luminance():
    one = np.zeros((6, 2, 2, 3))
    weights = []
    for channel in range(3):
        given = one.copy()
        given[..., channel] = 1.0
        weights.append(cube_weights(given).sum() / (4 * np.pi))
    assert np.allclose(weights, (0.2126, 0.7152, 0.0722), atol=1e-4)


@feature
@pytest.mark.parametrize(
    ("shape", "size", "sentence"),
    [
        ((5, 4, 4, 3), None, "a cube map is"),
        ((6, 4, 8, 3), None, "a cube map is"),
        ((6, 4, 4, 2), None, "a cube map is"),
        ((6, 4, 4, 3), 3, "no whole multiple of 3"),
        ((6, 4, 4, 3), 8, "no whole multiple of 8"),
        ((6, 4, 4, 3), 0, "no whole multiple of 0"),
    ],
)
def test_other_shapes_are_refused(shape, size, sentence):
    with pytest.raises(ValueError, match=sentence):
        cube_weights(np.ones(shape), size)


@feature
@pytest.mark.parametrize("bad", [-1.0, np.nan, np.inf])
def test_radiance_that_cannot_be_is_refused(bad):
    given = np.ones((6, 2, 2, 3))
    given[3, 1, 0, 2] = bad
    with pytest.raises(ValueError, match="finite and not negative"):
        cube_weights(given)
