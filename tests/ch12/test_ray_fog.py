"""Fog on traced pixels: what the eye sees through it is the rasterised picture's, by every way."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from common.environment import Environment
from common.numerics.transforms import pose_looking_at
from common.scene import Material
from common.view.camera import Perspective, View
from tests.support.scenes import nodes_at, quad_scene
from tests.support.shadows import box, placed, point
from tests.support.traced_pictures import light, off_edges, opened, picture, ways_of

pytestmark = pytest.mark.variants("vulkan", "gl")

ALONG = View(pose_looking_at((1.0, 1.6, 7.0), (0.0, 0.8, 0.0)), Perspective(0.9, 0.05))
HAZE = {"fog_density": 0.1, "fog_columns": 32, "fog_rows": 18, "fog_slices": 32, "fog_format": "rgba32f"}
BARE = {
    "ray_shadows": False,
    "ray_bounces": 0,
    "environment_size": 32,
    "fog_dither": False,
    "background": 0.5,
}
RASTER = 1e-3
"""What a traced and a rasterised picture may differ by, of the largest light."""


def street(around: bool):
    """Return a ground, two cubes and a lamp, with an environment or before a grey."""
    squares = (
        placed((0, 0, 0), (12, 12), (0, 1, 0)),
        *box((1.2, 0.5, 1.5), 1.0),
        *box((-2.0, 0.8, -4.0), 1.6),
    )
    paint = Material(base_color=(0.7, 0.5, 0.3, 1.0), roughness=1.0, metallic=0.0)
    scene = quad_scene(paint, matrices=squares)
    lamp, pose = point((0.5, 3.0, 2.0), 40.0)
    lamps = [replace(lamp, node=len(squares))]
    sky = Environment("grey", np.full((8, 16, 3), 0.5, np.float32)) if around else None
    return replace(scene, lights=lamps, nodes=nodes_at(*squares, pose), environment=sky)


@pytest.mark.parametrize(
    "around", [False, pytest.param(True, marks=pytest.mark.long)], ids=["background", "environment"]
)
def test_both_halves_are_seen_through_the_same_fog(chapter, around):
    """In the first frame, and in the next one with the history of fog."""
    scene, shown = street(around), {}
    clear = picture(chapter, scene, ALONG, **BARE, ray_way=ways_of(chapter)[0])
    for way in ("off", *ways_of(chapter)[:1]):
        knobs = {"rays": "off"} if way == "off" else {"ray_way": way}
        with opened(chapter, scene, **BARE, **HAZE, **knobs) as renderer:
            shown[way] = [light(renderer, ALONG) for _ in range(2)]
    for frame in (0, 1):
        drawn = shown["off"][frame]
        inner = off_edges(drawn, 0.05 * drawn.max())
        sky = np.abs(clear - clear[0, 0]).max(axis=-1) == 0
        assert inner.mean() > 0.5 and 0.1 < (sky & inner).mean() < 0.9
        for part in (sky, ~sky):
            assert np.abs(drawn - clear)[inner & part].mean() > 0.05 * clear.max()  # fog is there
        for way in ways_of(chapter)[:1]:
            traced = shown[way][frame]
            assert np.abs(traced - drawn)[inner].max() <= RASTER * drawn.max(), (way, frame)
            assert (np.abs(traced - drawn).max(axis=-1) > RASTER * drawn.max()).mean() < 0.02, (way, frame)


def test_without_fog_rays_read_none(chapter):
    way = ways_of(chapter)[0]
    for knobs, reads in (({}, False), (HAZE, True)):
        with opened(chapter, street(False), **BARE, **knobs, ray_way=way) as renderer:
            (rays,) = (it for it in renderer.passes if it.name == "rays")
            assert any(access.resource.startswith("fog_") for access in rays.reads) == reads
            assert any("fog" in name for name in renderer.graph.resources) == reads
