"""Paths of one scene with everything in it, found in different ways: all have the same mean."""

from __future__ import annotations

import numpy as np
import pytest

from tests.support.chapter import Chapter
from tests.support.path_pictures import (
    assert_agrees,
    assert_mean,
    light,
    opened,
    runs,
    runs_of,
    turned,
    z_scores,
)
from tests.support.path_scenes import CORNER, room
from tests.support.traced_pictures import ways_of

pytestmark = pytest.mark.variants("vulkan", "gl")

BOUNCES = 4


SAMPLES = pytest.mark.parametrize("samples", [3, pytest.param(16, marks=pytest.mark.long)])
"""Paths through a pixel in a run. More of them find smaller differences."""


@pytest.fixture(scope="module")
def seen_room(chapter):
    """Return a renderer of `room` with live knobs."""
    with opened(chapter, room(), path_bounces=BOUNCES, path_roulette=BOUNCES) as renderer:
        yield renderer


def assert_same(pictures):
    """Hold all runs to those of the first one."""
    first, *others = pictures
    for other in others:
        assert_agrees(z_scores(other - first, block=4))
        assert_mean(first.mean() + other - first, first, 0.03)


@pytest.mark.feature("path-tracer/mis")
@pytest.mark.feature("path-tracer/russian-roulette")
@SAMPLES
def test_strategies_lights_roulette_and_sequences_agree(seen_room, samples):
    """Each of them changes the error alone. Light along reflected rays alone misses little, but is found seldom."""
    each = [
        {},
        {"path_strategy": "bsdf"},
        {"path_strategy": "lights"},
        {"path_lights": "one"},
        {"path_roulette": 0},
        {"path_sequence": "sobol"},
    ]
    pictures = runs_of(seen_room, CORNER, each=each, path_samples=samples)
    assert_same(pictures)
    mis, bsdf, lights, _, roulette, _ = (picture.std(axis=0).mean() for picture in pictures)
    assert mis < 0.8 * bsdf and mis < 0.8 * lights
    assert not np.array_equal(pictures[0], pictures[4]) and roulette > 0.95 * mis


@pytest.mark.long
@pytest.mark.variants("vulkan")
@SAMPLES
def test_every_way_and_opengl_have_the_same_mean(chapter, gl_context, seen_room, samples):
    """Hits differ by roundings, and then all of a path. Each has random numbers of its own here."""
    more = {"path_samples": samples, "path_bounces": BOUNCES, "path_roulette": BOUNCES}
    ways = ways_of(chapter)[1:]  # `seen_room` has the first one
    pictures = runs_of(seen_room, CORNER, path_samples=samples)
    for seed, way in enumerate(ways, 1):
        pictures += runs(chapter, room(), CORNER, each=[{"path_seed": seed}], ray_way=way, **more)
    other = Chapter(chapter.which, "gl", gl_context)
    pictures += runs(other, room(), CORNER, each=[{"path_seed": 9}], **more)
    assert len(pictures) == len(ways) + 2 and not np.array_equal(pictures[0], pictures[-1])
    assert_same(pictures)


def test_the_same_calls_give_the_same_bits(seen_room):
    with turned(seen_room):
        first = light(seen_room, CORNER, 3)
        seen_room.reset_history("test")
        assert np.array_equal(light(seen_room, CORNER, 3), first)
        seen_room.settings.paths.path_seed = 1
        assert not np.array_equal(light(seen_room, CORNER, 3), first)
        seen_room.settings.paths.path_seed = 0
