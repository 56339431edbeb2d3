"""Paths of one scene with everything in it, found in different ways: all have the same mean."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from common.environment import Environment
from common.numerics.transforms import pose_looking_at
from common.scene import Material
from common.view.camera import Perspective, View
from tests.support.chapter import Chapter
from tests.support.path_pictures import assert_agrees, light, opened, runs, z_scores
from tests.support.scenes import nodes_at, quad_scene
from tests.support.shadows import box, placed, point, sun
from tests.support.traced_pictures import ways_of

pytestmark = pytest.mark.variants("vulkan", "gl")

VIEW = View(pose_looking_at((2.6, 1.9, 3.2), (0.0, 0.5, 0.0)), Perspective(0.8, 0.05))
BOUNCES = 4


def sky():
    """Return an environment with a bright spot, and light that differs by direction."""
    rows, columns = np.mgrid[:16, :32]
    texels = np.stack([rows / 16.0, 0.5 + 0.4 * np.sin(columns / 5.0), np.full((16, 32), 0.3)], axis=-1)
    texels[4, 9] = (45.0, 40.0, 30.0)
    return Environment("sky", (0.3 * texels).astype(np.float32))


def room():
    """Return a ground, a cube of smooth metal, a pane that lets light through, an emissive square, and two lights."""
    grey = Material(base_color=(0.7, 0.6, 0.5, 1.0), roughness=0.9, metallic=0.0, double_sided=True)
    metal = Material(base_color=(0.9, 0.7, 0.4, 1.0), roughness=0.4, metallic=1.0)
    pane = Material(
        base_color=(0.2, 0.5, 0.9, 0.4), roughness=0.6, metallic=0.0, alpha_mode="blend", double_sided=True
    )
    glow = Material(base_color=(0.1, 0.1, 0.1, 1.0), emissive=(6.0, 4.0, 2.0), roughness=0.8, metallic=0.0)
    squares = [
        placed((0, 0, 0), (5, 5), (0, 1, 0)),
        *box((-0.4, 0.5, -0.3), 0.9),
        placed((0.9, 0.6, 0.4), (0.9, 1.1), (0.6, 0, 1)),
        placed((0.6, 1.9, -0.6), (0.7, 0.7), (-0.2, -1.0, 0.3)),
    ]
    kinds = (0, *(1,) * 6, 2, 3)
    scene = quad_scene(materials=(grey, metal, pane, glow), matrices=tuple(squares), instance_materials=kinds)
    lamps = [point((-1.2, 1.6, 1.2), candela=4.0), sun((0.4, -1.0, -0.3), lux=1.5)]
    nodes = nodes_at(*squares, *(pose for _, pose in lamps))
    lights = [replace(lamp, node=len(squares) + place) for place, (lamp, _) in enumerate(lamps)]
    return replace(scene, nodes=nodes, lights=lights, environment=sky())


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
    pictures = runs(chapter, room(), VIEW, each=each, path_bounces=BOUNCES, path_roulette=BOUNCES)
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
            VIEW,
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
            runs(chapter, room(), VIEW, each=[{"path_seed": 1}], **more)[0],
            runs(other, room(), VIEW, each=[{"path_seed": 2}], **more)[0],
        ]
    )


def test_the_same_calls_give_the_same_bits(chapter):
    with opened(chapter, room(), path_bounces=BOUNCES) as renderer:
        first = light(renderer, VIEW, 3)
        renderer.reset_history("test")
        assert np.array_equal(light(renderer, VIEW, 3), first)
        renderer.settings.paths.path_seed = 1
        assert not np.array_equal(light(renderer, VIEW, 3), first)
