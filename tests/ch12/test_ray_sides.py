"""Surfaces with one side: rays from the eye and from mirrors skip backs, rays to lights what casts no shadow."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from common.numerics.transforms import pose_looking_at, rotation
from common.scene import Light, Material, Scene
from common.view.camera import Perspective, View
from tests.support.mirrors import PITCHED, mirror_and_wall
from tests.support.scenes import facing, nodes_at, quad_scene, translated
from tests.support.shadows import box, placed, point
from tests.support.traced_pictures import few_ways, off_edges, picture, ways_of

pytestmark = pytest.mark.variants("vulkan", "gl")

ACROSS = View(pose_looking_at((0.5, 1.5, 6.0), (0.0, 0.3, 0.0)), Perspective(0.9, 0.05))
RASTER = 1e-3
"""What a traced and a rasterised picture may differ by, of the largest light."""


# --- rays from the eye ---


def room(alpha_mode="opaque"):
    """Return a room whose walls have their backs outside, seen through one; a cube that is open to the eye for the same
    reason; a square with one side that is turned away, and before it one with two."""
    one = Material(base_color=(0.7, 0.5, 0.3, 1.0), roughness=1.0, metallic=0.0, alpha_mode=alpha_mode)
    walls = [matrix @ np.diag((1.0, 1.0, -1.0, 1.0)) for matrix in box((0.0, 1.0, 0.0), 5.0)]  # mirrored
    cube = [matrix @ np.diag((-1.0, 1.0, -1.0, 1.0)) for matrix in box((0.5, 0.5, 0.0), 1.2)]
    leaf = placed((-1.2, 0.8, 0.0), (1.5, 1.5), (-0.3, 0.2, -1.0))
    drawn = (*walls, *cube, leaf, leaf @ translated(-0.4, 0.4, 0.5))
    kinds = (0,) * (len(drawn) - 1) + (1,)
    both = replace(one, double_sided=True, base_color=(0.3, 0.5, 0.7, 1.0))
    scene = quad_scene(materials=(one, both), matrices=drawn, instance_materials=kinds)
    lamp, pose = point((0.6, 1.9, 1.6), 40.0)
    return replace(scene, lights=[replace(lamp, node=len(drawn))], nodes=nodes_at(*scene.nodes.matrix, pose))


@pytest.mark.parametrize("alpha_mode", ["opaque", pytest.param("mask", marks=pytest.mark.long)])
def test_backs_of_surfaces_with_one_side_are_not_there(chapter, alpha_mode):
    """As in the rasterised picture, by every way."""
    scene, knobs = room(alpha_mode), {"ray_shadows": False, "ray_bounces": 0}
    drawn = picture(chapter, scene, ACROSS, **knobs, rays="off")
    inner = off_edges(drawn, 0.05 * drawn.max())
    solid = replace(scene, materials=[replace(it, double_sided=True) for it in scene.materials])
    other = picture(chapter, solid, ACROSS, **knobs, rays="off")
    assert inner.mean() > 0.5 and (np.abs(other - drawn).max(axis=-1) > 0.1 * other.max(axis=-1)).mean() > 0.3
    for way in ways_of(chapter):
        traced = picture(chapter, scene, ACROSS, **knobs, ray_way=way)
        assert np.abs(traced - drawn)[inner].max() <= RASTER * drawn.max(), way
        assert (np.abs(traced - drawn).max(axis=-1) > RASTER * drawn.max()).mean() < 0.02, way


# --- shadows ---

MATTE = Material(base_color=(0.5, 0.5, 0.5, 1.0), metallic=0.0, roughness=1.0)
SIZE, TILT, HEIGHT = 48, 0.6, 0.3
PLACES = (0.6, 0.0, -0.6)


def plates() -> Scene:
    """Return a ground, and above it plates that face the sun, the ground, and the ground with two sides."""
    small, turned = np.diag((0.2, 0.2, 1.0, 1.0)), rotation((0.0, 1.0, 0.0), np.pi)
    above = [translated(0.4, y, HEIGHT) @ small for y in PLACES]
    squares = (np.eye(4), above[0], above[1] @ turned, above[2] @ turned)
    return quad_scene(
        materials=(MATTE, replace(MATTE, double_sided=True)),
        matrices=(*squares, rotation((0.0, 1.0, 0.0), TILT)),
        instance_materials=(0, 0, 0, 1),
        lights=(Light("directional", node=4, intensity=3.0),),
    )


@pytest.mark.parametrize("sides", [pytest.param("both", marks=pytest.mark.long), "front"])
def test_the_sides_that_cast_shadows_are_those_of_shadow_maps(chapter, sides):
    """A plate that turns its back to the sun has a shadow if both sides cast them. The eye does not see its back."""
    column = int((0.4 - HEIGHT * np.tan(TILT) + 1) / 2 * SIZE)
    rows = [int((1 - y) / 2 * SIZE) for y in PLACES]
    wanted = [True, sides == "both", True]
    for way in few_ways(chapter):
        for knobs in ({"ray_way": way}, {"rays": "off", "shadows": "on"}):
            seen = picture(chapter, plates(), facing(), (SIZE, SIZE), shadow_sides=sides, **knobs)[..., 0]
            lit = seen[SIZE // 2, 4]
            assert lit > 0.0 and [seen[row, column] < 0.5 * lit for row in rows] == wanted, knobs
            plate = seen[[rows[0], rows[1]], int(1.5 / 2 * SIZE)]
            assert plate == pytest.approx([lit, lit], rel=0.02)


# --- mirrors ---


@pytest.mark.parametrize("away", [False, True], ids=["front", "back"])
def test_a_mirror_shows_fronts_alone(chapter, away):
    """A wall that turns its back to the mirror and to the eye is in no part of the picture."""
    scene, _ = mirror_and_wall(turn=0.4 + np.pi * away)
    for way in few_ways(chapter):
        seen = picture(chapter, scene, PITCHED, ray_way=way, background=0.25)
        shown = (np.abs(seen - (0.5, 0.25, 0.75)).max(axis=-1) < 1e-6).mean()
        assert shown == 0.0 if away else shown > 0.2, way
