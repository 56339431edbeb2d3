"""The traced picture by each way: against the rasterised one, closed forms, and rays against every triangle."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from common.environment import Environment
from common.images.palette import id_color
from common.numerics.transforms import pose_looking_at
from common.scene import Light, Material
from common.view.camera import Orthographic, Perspective, View
from tests.support.chapter import Chapter
from tests.support.mirrors import FLAT, PITCHED, mirror_and_wall, mirror_of
from tests.support.ray_scenes import placements, soup, soup_scene, two_sided, world_triangles
from tests.support.scenes import nodes_at, quad_scene, translated
from tests.support.shadows import placed, point, yard
from tests.support.traced_pictures import (
    SIZE,
    few_ways,
    light,
    off_edges,
    opened,
    picture,
    primary_rays,
    ways_of,
)
from tests.twins.brute_rays import nearest

pytestmark = pytest.mark.variants("vulkan", "gl")

VIEW = View(pose_looking_at((3.0, 2.5, 4.0), (0.0, 0.4, 0.0)), Perspective(0.9, 0.05))
LAMP = point((-1.2, 3.0, 0.8))
LENSES = ("perspective", "orthographic")
RASTER = 1e-3
"""What a traced and a rasterised picture may differ by, of the largest light."""


def court(*more):
    """Return a ground, a floating cube that is a little smooth, and a lamp."""
    return yard(LAMP, *more, material=Material(roughness=0.1, metallic=0.9, double_sided=True))


# --- ways and backends ---


@pytest.mark.core
@pytest.mark.variants("vulkan")
@pytest.mark.feature("ray-tracing/software-bvh")
def test_every_way_gives_the_same_picture(chapter):
    """Hits differ by roundings, which two mirrors enlarge; an edge may fall to the other side."""
    seen = {way: picture(chapter, court(), VIEW, ray_way=way) for way in ways_of(chapter)}
    base = seen.pop("bvh")
    assert base.std() > 0.1 * base.mean() > 0.0
    for way, other in seen.items():
        close = np.abs(other - base).max(axis=-1) <= 1e-4 * base.max()
        assert close.mean() >= 0.995 and close[off_edges(base, 0.05 * base.max())].all(), way


@pytest.mark.variants("vulkan")
@pytest.mark.feature("ray-tracing/software-bvh")
def test_opengl_gives_the_picture_of_vulkan(chapter, gl_context):
    one = picture(chapter, court(), VIEW, ray_way="bvh")
    other = picture(Chapter(chapter.which, "gl", gl_context), court(), VIEW, ray_way="bvh")
    close = np.abs(other - one).max(axis=-1) <= 1e-4 * one.max()
    assert close.mean() >= 0.995 and close[off_edges(one, 0.05 * one.max())].all()


# --- against the rasterised picture ---


def panorama():
    """Return an environment whose light differs by direction."""
    rows, columns = np.mgrid[:8, :16]
    texels = np.stack([rows / 8.0, 0.5 + 0.4 * np.sin(columns / 2.5), np.full((8, 16), 0.3)], axis=-1)
    return Environment("panorama", texels.astype(np.float32))


def crowd():
    """Return squares that are turned, squeezed, mirrored and behind one another, one of them unlit."""
    grey = Material(base_color=(0.7, 0.5, 0.3, 1.0), roughness=0.6, metallic=0.2, double_sided=True)
    plain = Material(base_color=(0.2, 0.6, 0.4, 1.0), unlit=True, double_sided=True)
    drawn = [placed((0, -1, 0), (8, 8), (0, 1, 0)), *placements()]
    scene = quad_scene(materials=(grey, plain), matrices=tuple(drawn), instance_materials=(0, 0, 1, 0, 0))
    nodes = nodes_at(*drawn, translated(0.5, 2.0, 2.5), pose_looking_at((0, 0, 0), (0.3, -1.0, -0.4)))
    lamps = [Light("point", 5, intensity=20.0), Light("directional", 6, intensity=2.0)]
    return replace(scene, nodes=nodes, lights=lamps)


ACROSS = View(pose_looking_at((0.5, 1.5, 6.0), (0.0, 0.3, 0.0)), Perspective(0.9, 0.05))
ALONG = View(pose_looking_at((0.5, 1.5, 6.0), (0.0, 0.3, 0.0)), Orthographic(3.0, 0.5, 30.0))


@pytest.mark.core
@pytest.mark.feature("ray-tracing/camera-rays")
@pytest.mark.parametrize(
    ("view", "around"),
    [
        pytest.param(ACROSS, False, id="background-perspective"),
        pytest.param(ALONG, True, id="environment-orthographic"),
        pytest.param(ALONG, False, id="background-orthographic", marks=pytest.mark.long),
        pytest.param(ACROSS, True, id="environment-perspective", marks=pytest.mark.long),
    ],
)
def test_without_shadows_and_mirrors_it_is_the_rasterised_picture(chapter, view, around):
    """Positions come from barycentric coordinates here and from depth there: both are off by some units."""
    scene = replace(crowd(), environment=panorama() if around else None)
    knobs = {"ray_shadows": False, "ray_bounces": 0, "environment_size": 32}
    drawn = picture(chapter, scene, view, **knobs, rays="off")
    inner = off_edges(drawn, 0.05 * drawn.max())
    assert inner.mean() > 0.5 and drawn[inner].std() > 0.05 * drawn.max()
    for way in few_ways(chapter):
        traced = picture(chapter, scene, view, **knobs, ray_way=way)
        assert np.abs(traced - drawn)[inner].max() <= RASTER * drawn.max(), way
        assert (np.abs(traced - drawn).max(axis=-1) > RASTER * drawn.max()).mean() < 0.02, way


def test_beside_the_split_both_pictures_are_there(chapter):
    """Left of it the rasterised one to the bit, right of it the traced one."""
    way = ways_of(chapter)[0]
    whole = picture(chapter, court(), VIEW, ray_way=way)
    drawn = picture(chapter, court(), VIEW, rays="off")
    for share, columns in ((0.0, 0), (0.51, 21), (1.0, 40)):
        with opened(chapter, court(), rays="beside", ray_split=share, ray_way=way) as renderer:
            both = light(renderer, VIEW)
        assert np.array_equal(both[:, :columns], drawn[:, :columns])
        assert np.array_equal(both[:, columns:], whole[:, columns:])
    assert not np.array_equal(whole, drawn)


# --- shadows and mirrors in closed form ---


def test_a_square_casts_the_shadow_of_its_outline(chapter):
    """A lamp at height h over the middle of a square of edge a at height s casts a shadow of edge a h / (h - s)."""
    height, at, edge = 4.0, 1.0, 1.5
    scene = quad_scene(
        Material(roughness=1.0, metallic=0.0, double_sided=True),
        matrices=(placed((0, 0, 0), (8, 8), (0, 1, 0)), placed((0.5, at, -0.25), (edge, edge), (0, 1, 0))),
    )
    lamp, pose = point((0.5, height, -0.25))
    scene = replace(scene, lights=[replace(lamp, node=2)], nodes=nodes_at(*scene.nodes.matrix, pose))
    view = View(pose_looking_at((0.0, 0.9, 0.0), (0.0, 0.0, 0.0), (0, 0, -1)), Orthographic(1.8, 0.1, 3.0))
    rows, columns = np.mgrid[:48, :48] + 0.5
    x, z = (columns / 24 - 1) * 1.8 - 0.5, (rows / 24 - 1) * 1.8 + 0.25
    half = edge / 2 * height / (height - at)
    inside = np.maximum(np.abs(x), np.abs(z)) - half
    assert np.abs(inside).min() > 1e-3 and 200 < (inside < 0).sum() < 1500
    for way in few_ways(chapter):
        seen = picture(chapter, scene, view, (48, 48), ray_way=way)
        assert np.array_equal(seen.sum(axis=-1) == 0.0, inside < 0), way
        # Where it is lit, the light of a matte surface falls with the square of the distance and twice with the cosine.
        near = (seen[..., 1] * (x**2 + z**2 + height**2) ** 1.5)[inside > 0]
        assert near.std() < 0.02 * near.mean(), way


@pytest.mark.parametrize("view", [PITCHED, pytest.param(FLAT, marks=pytest.mark.long)], ids=LENSES)
def test_a_mirror_shows_the_mirrored_wall(chapter, view):
    """The floor shows the wall where the mirrored ray meets it, else the background; without such rays, nothing."""
    scene, place = mirror_and_wall(turn=0.4)
    pixels, _, _, wall = mirror_of(view, SIZE, place)
    outside = np.abs(wall).max(axis=1) - 1
    origins, directions = primary_rays(view, SIZE)
    truth = nearest(origins - scene.origin, directions, 0.0, 1e4, *world_triangles(scene))
    floor = ((truth.instance == 0) & (truth.margin > 1e-4)).reshape(SIZE[::-1])[pixels[:, 1], pixels[:, 0]]
    shows, misses = floor & (outside < -1e-3), floor & (outside > 1e-3)
    assert shows.sum() > 50 and misses.sum() > 50
    for way in few_ways(chapter):
        seen = picture(chapter, scene, view, ray_way=way, background=0.25)[pixels[:, 1], pixels[:, 0]]
        assert np.abs(seen[shows] - (0.5, 0.25, 0.75)).max() < 1e-6, way
        assert np.abs(seen[misses] - 0.25).max() < 1e-6, way
        dark = picture(chapter, scene, view, ray_way=way, ray_bounces=0, background=0.25)
        assert not dark[pixels[:, 1], pixels[:, 0]][floor].any(), way


# --- views ---


def shapes():
    """Return random triangles: as they are, turned, squeezed and mirrored; every second instance has one side."""
    drawn = [(k % 2, matrix) for k, matrix in enumerate(placements())]
    return soup_scene(
        [soup(20, 1), soup(16, 2)], drawn, (Material(double_sided=True), Material()), material_of=(0, 1)
    )


@pytest.mark.feature("ray-tracing/camera-rays")
@pytest.mark.parametrize("view", [pytest.param(ACROSS, marks=pytest.mark.long), ALONG], ids=LENSES)
def test_views_show_what_every_triangle_says(chapter, view):
    scene = shapes()
    with scene.edit() as edit:
        edit.set_visible(2, False)
    origins, directions = primary_rays(view, SIZE)
    triangles, ids = world_triangles(scene)
    truth = nearest(origins - scene.origin, directions, 0.0, 1e4, triangles, ids, backs=two_sided(scene, ids))
    both = nearest(origins - scene.origin, directions, 0.0, 1e4, triangles, ids)
    assert ((both.instance != truth.instance) & (truth.margin > 1e-4)).sum() > 10
    hit = truth.instance >= 0
    sure, scale = truth.margin > 1e-4, scene.length_scale
    assert sure.mean() > 0.8 and {0, 1, 3} == set(truth.instance[hit & sure].tolist())
    at = np.column_stack([1 - truth.at.sum(axis=1), truth.at])
    wanted = {
        "distance": np.where(hit, 1.0 - scale / (truth.t + scale), 0.0)[:, None],
        "instance": np.where(hit[:, None], id_color(np.maximum(truth.instance, 0)), 0.0),
        "barycentrics": np.where(hit[:, None], at, 0.0),
    }
    for way in few_ways(chapter):
        for name, value in wanted.items():
            seen = picture(chapter, scene, view, ray_way=way, ray_view=name).reshape(-1, 3)
            assert np.abs(seen - value)[sure].max() < (2e-5 if name == "distance" else 5e-4), (way, name)
