"""Paths of one scene with everything in it, found in different ways: all have the same mean."""

from __future__ import annotations

import numpy as np
import pytest

from tests.support.chapter import Chapter
from tests.support.path_pictures import assert_agrees, light, opened, runs, z_scores
from tests.support.path_scenes import CORNER, room
from tests.support.traced_pictures import ways_of

pytestmark = pytest.mark.variants("vulkan", "gl")

BOUNCES = 4


def assert_same(pictures):
    """Hold all runs to those of the first one."""
    first, *others = pictures
    for other in others:
        assert_agrees(z_scores(other - first, block=8))
        assert abs(other.mean() / first.mean() - 1.0) < 0.02


@pytest.mark.core
@pytest.mark.feature("path-tracer/mis")
@pytest.mark.feature("path-tracer/russian-roulette")
def test_strategies_lights_roulette_and_sequences_agree(chapter):
    """Each of them changes the error alone. Light along reflected rays alone misses little, but is found seldom."""
    each = [
        {"path_samples": 16},
        {"path_samples": 16, "path_strategy": "bsdf"},
        {"path_samples": 16, "path_strategy": "lights"},
        {"path_samples": 16, "path_lights": "one"},
        {"path_samples": 16, "path_roulette": 0},
        {"path_samples": 16, "path_sequence": "sobol"},
    ]
    pictures = runs(chapter, room(), CORNER, each=each, path_bounces=BOUNCES, path_roulette=BOUNCES)
    assert_same(pictures)
    mis, bsdf, lights, _, roulette, _ = (picture.std(axis=0).mean() for picture in pictures)
    assert mis < 0.6 * bsdf and mis < 0.7 * lights
    assert roulette > 1.01 * mis


@pytest.mark.variants("vulkan")
def test_every_way_has_the_same_mean(chapter):
    """Hits differ by roundings, and then all of a path; the random numbers are the same."""
    pictures = [
        runs(
            chapter,
            room(),
            CORNER,
            8,
            each=[{"path_seed": seed}],
            path_samples=16,
            path_bounces=BOUNCES,
            ray_way=way,
        )[0]
        for seed, way in enumerate(ways_of(chapter))
    ]
    assert_same(pictures)


@pytest.mark.variants("vulkan")
def test_opengl_has_the_mean_of_vulkan(chapter, gl_context):
    more = {"path_samples": 16, "path_bounces": BOUNCES}
    other = Chapter(chapter.which, "gl", gl_context)
    assert_same(
        [
            runs(chapter, room(), CORNER, each=[{"path_seed": 1}], **more)[0],
            runs(other, room(), CORNER, each=[{"path_seed": 2}], **more)[0],
        ]
    )


def test_the_same_calls_give_the_same_bits(chapter):
    with opened(chapter, room(), path_bounces=BOUNCES) as renderer:
        first = light(renderer, CORNER, 3)
        renderer.reset_history("test")
        assert np.array_equal(light(renderer, CORNER, 3), first)
        renderer.settings.paths.path_seed = 1
        assert not np.array_equal(light(renderer, CORNER, 3), first)
