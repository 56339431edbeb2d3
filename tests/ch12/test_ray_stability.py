"""Rays that leave surfaces: no surface shades itself and no light comes through one, at any scale and any place."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from common.numerics.transforms import pose_looking_at, rotation
from common.scene import Material
from common.view.camera import Perspective, View
from tests.support.scenes import moved, nodes_at, quad_scene, scaled
from tests.support.shadows import box, placed, point, sun
from tests.support.traced_pictures import picture, primary_rays, ways_of

pytestmark = [
    pytest.mark.variants("vulkan", "gl"),
    pytest.mark.feature("ray-tracing/self-intersection-offset"),
]

SIZE = (40, 30)
CASES = {
    "as it is": lambda scene, view: (scene, view),
    "small": lambda scene, view: scaled(scene, view, 1e-3),
    "large": lambda scene, view: scaled(scene, view, 1e3),
    "far": lambda scene, view: moved(scene, view, (1e5, 0.0, 0.0)),
    "far away": lambda scene, view: moved(scene, view, (-1e5, 1e5, 1e5)),
}
MATTE = Material(roughness=1.0, metallic=0.0, double_sided=True)
TURN = rotation((0.3, 1.0, 0.2), 0.7)
"""Planes that lie along no axis: their points round in each component."""


LONG = ("as it is", "large", "far")


@pytest.fixture(
    params=[pytest.param(name, marks=pytest.mark.long) if name in LONG else name for name in CASES]
)
def case(request):
    return CASES[request.param]


def shadowed(chapter, scene, view):
    """Yield a way and the light of a picture with shadows, for the first and the last way; before them without any."""
    ways = ways_of(chapter)
    knobs = {"ray_bounces": 0, "ray_way": ways[-1]}
    yield "", picture(chapter, scene, view, SIZE, **knobs, ray_shadows=False).max(axis=-1)
    for way in dict.fromkeys((ways[-1], ways[0])):
        yield way, picture(chapter, scene, view, SIZE, **knobs | {"ray_way": way}).max(axis=-1)


def lit(matrices, lamp, pose, material=MATTE):
    """Return a scene of squares with one lamp."""
    scene = quad_scene(material, matrices=tuple(matrices))
    return replace(scene, lights=[replace(lamp, node=len(matrices))], nodes=nodes_at(*matrices, pose))


def test_a_plane_under_grazing_light_does_not_shade_itself(chapter, case):
    """Every pixel of the plane has the light that it would have without shadows, under an angle of 0.02 degrees."""
    angle = np.radians(0.02)
    lamp, pose = sun((np.cos(angle), -np.sin(angle), 0.0), lux=1e4)
    scene = lit([TURN @ placed((0, 0, 0), (4, 4), (0, 1, 0))], lamp, TURN @ pose)
    view = View(TURN @ pose_looking_at((0.4, 1.2, 2.6), (0.1, 0.0, 0.0)), Perspective(0.9, 0.02))
    scene, view = case(scene, view)
    (_, plain), *others = shadowed(chapter, scene, view)
    assert (plain > 0).mean() > 0.3
    for way, seen in others:
        assert np.abs(seen - plain).max() <= 1e-3 * plain.max(), way


@pytest.mark.core
def test_a_closed_box_stays_dark_inside(chapter, case):
    """A lamp stands outside. Edges where squares meet let nothing through; without shadows it is bright inside."""
    lamp, pose = point((3.0, 2.0, 1.5), candela=1e4)
    walls = [TURN @ it for it in box((0.0, 0.0, 0.0), 2.0)]
    scene = lit(walls, lamp, TURN @ pose)
    view = View(TURN @ pose_looking_at((-0.6, -0.5, 0.7), (0.5, 0.4, -0.6)), Perspective(1.6, 0.02))
    scene, view = case(scene, view)
    (_, plain), *others = shadowed(chapter, scene, view)
    assert (plain > 0).mean() > 0.2
    for way, seen in others:
        assert not seen.any(), way


def test_a_shadow_begins_where_a_wall_stands_on_the_ground(chapter, case):
    """Light comes from behind the wall: the ground in front of it is dark up to a thousandth of the wall's height."""
    lamp, pose = sun((0.0, -1.0, 1.0), lux=1e4)
    ground, wall = placed((0, 0, 0), (4, 4), (0, 1, 0)), placed((0, 0.5, 0), (1, 1), (0, 0, 1))
    scene = lit([TURN @ ground, TURN @ wall], lamp, TURN @ pose)
    eye = View(TURN @ pose_looking_at((0.0, 0.05, 0.1), (0.0, 0.0, 0.01)), Perspective(0.3, 0.01))
    origins, directions = (it @ TURN[:3, :3] for it in primary_rays(eye, SIZE))
    t = -origins[:, 1] / directions[:, 1]
    points = (origins + t[:, None] * directions).reshape(*SIZE[::-1], 3)
    near = (t > 0).reshape(SIZE[::-1]) & (points[..., 2] > 1e-3) & (points[..., 2] < 0.5)
    assert near.sum() > 500 and points[near][:, 2].min() < 3e-3 and np.abs(points[near][:, 0]).max() < 0.45
    scene, view = case(scene, eye)
    (_, plain), *others = shadowed(chapter, scene, view)
    assert (plain[near] > 0).all()
    for way, seen in others:
        assert not seen[near].any(), way
