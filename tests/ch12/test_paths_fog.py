"""Paths in a medium: what arrives through it, what it scatters once, and what it does in light from everywhere."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from common.environment import constant
from common.numerics.transforms import pose_looking_at
from common.scene import FogBox, Material, Medium
from common.view.camera import Orthographic, Perspective, View
from tests.support.fog import twin_of
from tests.support.path_pictures import (
    SIZE,
    assert_agrees,
    assert_mean,
    light,
    opened,
    runs,
    runs_of,
    turned,
    z_scores,
)
from tests.support.path_scenes import CORNER, MATTE, room
from tests.support.scenes import nodes_at, quad_scene
from tests.support.shadows import placed, point
from tests.support.traced_pictures import primary_rays
from tests.twins import fog as twin

pytestmark = pytest.mark.variants("vulkan", "gl", long=("gl",))
"""A cold driver of OpenGL takes 5 to 15 s for the kernel of each of these tests."""

MEDIUM = Medium(
    extinction=0.04,
    height_extinction=0.25,
    height_falloff=0.8,
    height_base=-0.5,
    albedo=(0.9, 0.8, 0.7),
    boxes=(FogBox((1.0, 0.4, -1.5), (0.8, 0.7, 0.9), 0.5, (0.2, 0.5, 0.9)),),
)
LAMP, CANDELA, G = (-0.8, 0.9, -1.2), 20.0, 0.6
EYE = np.array((0.3, 0.2, 3.0))
VIEW = View(pose_looking_at(EYE, (0.0, 0.1, -4.0)), Perspective(0.6, 0.05))
BLACK = Material(base_color=(0.0, 0.0, 0.0, 1.0), unlit=True)


def before_wall(material, medium, *lamps):
    """Return a wall of 8x8 metres at z = -4 in a medium, with lights at their poses, and a speck that they light."""
    wall, speck = placed((0, 0, -4.0), (8, 8), (0, 0, 1)), placed((3.9, 3.9, -4.0), (1e-3, 1e-3), (0, 0, 1))
    scene = quad_scene(materials=(material, MATTE), matrices=(wall, speck), instance_materials=(0, 1))
    lights = [replace(lamp, node=2 + number) for number, (lamp, _) in enumerate(lamps)]
    return replace(
        scene, nodes=nodes_at(wall, speck, *(pose for _, pose in lamps)), lights=lights, medium=medium
    )


def to_wall():
    """Return (N, 3) origins and directions of the rays through centres, and (N,) their lengths to the wall."""
    origins, directions = primary_rays(VIEW, SIZE)
    return origins, directions, (-4.0 - origins[:, 2]) / directions[:, 2]


@pytest.mark.feature("path-tracer/core")
def test_light_of_a_wall_arrives_by_its_optical_depth(chapter):
    """All three media absorb: what is left of each ray's light is exp(-depth), up and down through all heights."""
    wall = Material(base_color=(0.0, 0.0, 0.0, 1.0), metallic=1.0, roughness=1.0, emissive=(2.0, 1.0, 0.5))
    box = replace(MEDIUM.boxes[0], albedo=(0.0, 0.0, 0.0))
    scene = before_wall(wall, replace(MEDIUM, albedo=(0.0, 0.0, 0.0), boxes=(box,)))
    origins, directions, lengths = to_wall()
    depth = twin_of(MEDIUM).optical_depth(origins, origins + lengths[:, None] * directions)
    truth = np.exp(-depth).reshape(*SIZE[::-1], 1) * np.array((2.0, 1.0, 0.5))
    assert truth.min() < 0.4 * truth[..., 2].max()
    (seen,) = runs(chapter, scene, VIEW, path_samples=16, path_bounces=2, path_filter="centre")
    assert_agrees(z_scores(seen, truth))
    with opened(chapter, scene, path_filter="centre", fog=False) as renderer:
        assert np.abs(light(renderer, VIEW) - (2.0, 1.0, 0.5)).max() < 1e-5


@pytest.mark.feature("path-tracer/core")
def test_light_that_is_scattered_once(chapter):
    """A point light in the medium before a black wall: the quadrature of single scattering along each ray."""
    scene = before_wall(BLACK, MEDIUM, point(LAMP, CANDELA))
    lamp = twin.Light(LAMP, (CANDELA,) * 3)
    truth, _ = twin.single_scattering(*to_wall(), twin_of(MEDIUM), lamp, G)
    knobs = {"path_bounces": 1, "path_filter": "centre", "fog_anisotropy": G}
    with opened(chapter, scene, **knobs) as renderer:
        (seen,) = runs_of(renderer, VIEW, path_samples=24)
        with turned(renderer, path_bounces=0):
            assert not light(renderer, VIEW).any()
    truth = truth.reshape(*SIZE[::-1], 3)
    # Few paths come near to the lamp, where light has no bound: pixels there have errors that runs do not tell.
    calm = np.linalg.norm(np.cross(np.array(LAMP) - EYE, to_wall()[1]), axis=1).reshape(SIZE[::-1]) > 0.5
    seen, truth = seen * calm[..., None], truth * calm[..., None]
    assert calm.mean() > 0.5 and truth.max() > 0.0
    assert_agrees(z_scores(seen, truth, block=8))
    assert_mean(seen, truth, 0.05)


@pytest.mark.feature("path-tracer/core")
def test_a_medium_counts_up_to_the_lamp(chapter):
    """Rays end before the lamp, where its bulb would cast a shadow, and the medium does not: a dense box is there."""
    lamp, half, extinction = np.array((-0.8, 0.9, -1.2)), 0.02, 100.0
    seen = []
    for dense in (1e-9, extinction):
        box = FogBox(tuple(lamp), (half,) * 3, dense, (0.0, 0.0, 0.0))
        scene = before_wall(MATTE, Medium(boxes=(box,)), point(tuple(lamp), CANDELA))
        with opened(chapter, scene, path_bounces=1, path_filter="centre", path_samples=1) as renderer:
            seen.append(light(renderer, VIEW))
    origins, directions, lengths = to_wall()
    away = origins + lengths[:, None] * directions - lamp
    metres = half * np.linalg.norm(away, axis=1) / np.abs(away).max(axis=1)
    ratio = np.exp(-extinction * metres).reshape(SIZE[::-1])
    clear = seen[0][..., 0] > 0.0
    assert clear.mean() > 0.9
    # Rays begin some 1e-5 m off the wall, of which the box makes 1e-3.
    np.testing.assert_allclose((seen[1][..., 0] / seen[0][..., 0])[clear], ratio[clear], rtol=1e-2)


@pytest.mark.feature("path-tracer/mis")
def test_a_white_medium_in_a_furnace_cannot_be_seen(chapter):
    """Light that is 1 nit from everywhere stays so, however often it is scattered, by each strategy."""
    medium = Medium(extinction=0.3, albedo=(1.0, 1.0, 1.0))
    speck = placed((3.9, 3.9, -4.0), (1e-3, 1e-3), (0, 0, 1))
    corner = placed((-3.9, -3.9, 3.0), (1e-3, 1e-3), (0, 0, 1))
    scene = replace(
        quad_scene(Material(), matrices=(speck, corner), instance_materials=(0, 0)),
        medium=medium,
        environment=constant(1.0),
    )
    each = [{"path_strategy": name} for name in ("mis", "bsdf", "lights")]
    view = View(pose_looking_at((0.0, 0.0, 3.0), (0.0, 0.0, -4.0)), Orthographic(1.5, 0.1, 20.0))
    for seen in runs(chapter, scene, view, each=each, path_samples=4, path_bounces=64, path_roulette=64):
        assert abs(seen.mean() - 1.0) < 0.02
        assert_agrees(z_scores(seen, 1.0))


@pytest.mark.long
@pytest.mark.variants("vulkan")
@pytest.mark.feature("path-tracer/mis")
def test_strategies_agree_in_a_medium(chapter):
    """Everything at once: surfaces, all kinds of light, and height fog with a box."""
    box = FogBox((0.6, 0.6, 0.6), (0.5, 0.5, 0.5), 1.0, (0.9, 0.6, 0.3))
    medium = Medium(height_extinction=0.4, height_falloff=1.0, albedo=(0.9, 0.9, 0.9), boxes=(box,))
    each = [{"path_strategy": name} for name in ("mis", "bsdf", "lights")]
    # Without the point light: near it in a medium, light has no bound, and means are never known.
    sunny = [lamp for lamp in room().lights if lamp.kind == "directional"]
    scene = replace(room(), medium=medium, lights=sunny)
    first, *others = runs(chapter, scene, CORNER, each=each, path_samples=32, path_bounces=4)
    for other in others:
        assert_agrees(z_scores(other - first))
        assert abs(other.mean() / first.mean() - 1.0) < 0.02
