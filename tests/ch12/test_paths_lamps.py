"""Lamps that have a body: lights within bulbs, lights that stand for a surface, and what the eye sees from behind."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from common.numerics.transforms import pose_looking_at
from common.scene import Light, Material
from common.view.camera import Orthographic, View
from tests.support.path_pictures import light, opened, turned
from tests.support.path_scenes import ABOVE, MATTE
from tests.support.scenes import nodes_at, quad_scene
from tests.support.shadows import box, placed, point

pytestmark = pytest.mark.variants("vulkan", "gl", long=("gl",))
"""A cold driver of OpenGL takes 5 to 15 s for the kernel of each of these tests."""

GROUND = placed((0, 0, 0), (8, 8), (0, 1, 0))
BULB = Material(base_color=(0.0, 0.0, 0.0, 1.0), metallic=1.0, roughness=1.0, emissive=(1.0, 1.0, 1.0))


def lamp(edge: float, candela: float = 60.0, said: object = None):
    """Return a ground, and above it a point light in a cube that emits a little; `said` is its node's `stands_for`."""
    sides = box((0.0, 1.0, 0.0), edge)
    own, pose = point((0.0, 1.0, 0.0), candela)
    materials = (0, *[1] * len(sides))
    scene = quad_scene(materials=(MATTE, BULB), matrices=(GROUND, *sides), instance_materials=materials)
    nodes = nodes_at(GROUND, *sides, pose)
    extras = {} if said is None else {len(sides) + 1: {"strata": {"stands_for": said}}}
    lights: list[Light] = [replace(own, node=len(sides) + 1)]
    return replace(scene, lights=lights, nodes=replace(nodes, extras=extras))


def seen(chapter, scene, **more):
    """Return the light (H, W, 3) of 16 paths a pixel, reflected once."""
    with opened(chapter, scene, path_samples=16, path_bounces=1, **more) as renderer:
        return light(renderer, ABOVE)


@pytest.mark.feature("path-tracer/core")
def test_a_bulb_casts_no_shadow_of_its_own_lamp(chapter):
    """Within shadow_near of the lamp nothing casts its shadow, as in shadow maps; a cube that is larger does."""
    near = 0.1 / lamp(0.1).length_scale
    small = seen(chapter, lamp(0.1), shadow_near=near)
    dark = seen(chapter, lamp(0.1, 0.0), shadow_near=near)
    large = seen(chapter, lamp(0.5), shadow_near=near)
    assert small.mean() > 5.0 * dark.mean() > 0.0
    assert large.mean() < 0.5 * small.mean()


@pytest.mark.feature("path-tracer/core")
@pytest.mark.parametrize(("said", "counts"), [("name", False), ("no node", True), (7, True), ({}, True)])
def test_a_light_that_stands_for_a_surface_is_counted_once(chapter, said, counts):
    name = lamp(0.1).nodes.names[1] if said == "name" else said
    settings = {"shadow_near": 0.1 / lamp(0.1).length_scale}
    told = seen(chapter, lamp(0.1, said=name), **settings)
    alone = seen(chapter, lamp(0.1, 0.0), **settings)
    assert np.array_equal(told, alone) != counts


@pytest.mark.feature("path-tracer/core")
@pytest.mark.parametrize("order", [(0, 1), (1, 0)])
def test_two_faces_in_one_plane_back_to_back_show_their_fronts(chapter, order):
    """Exporters write leaves and cloth so. The eye passes through backs of single-sided surfaces alone."""
    glow = replace(BULB, emissive=(3.0, 3.0, 3.0))
    squares = [placed((0, 1, 0), (9, 9), (0, way, 0)) for way in (1, -1)]
    materials = (BULB, glow)
    scene = quad_scene(
        materials=materials,
        matrices=tuple(squares[k] for k in order),
        instance_materials=tuple(order),
    )
    view = View(
        pose_looking_at((0.3, 3.0, 0.2), (0.3, 0.0, 0.2), (0.0, 0.0, -1.0)), Orthographic(1.0, 0.1, 9.0)
    )
    with opened(chapter, scene, path_bounces=0) as renderer:
        assert np.allclose(light(renderer, view), 1.0, rtol=1e-3)


@pytest.mark.feature("path-tracer/core")
def test_a_limit_below_what_there_is_lets_the_picture_rest(chapter):
    with opened(chapter, lamp(0.1), path_samples=16, path_bounces=1) as renderer:
        first = light(renderer, ABOVE, 2)
        renderer.settings.paths.path_limit = 8
        assert np.array_equal(light(renderer, ABOVE), first)
        with turned(renderer, path_limit=8):
            frame = renderer.render(ABOVE, 0.0)
            frame.image("color_linear")
            assert frame.work["path_samples"] == 8
