"""Casters drawn to layers by task and mesh shaders: the maps of the compute path, bit by bit, and what groups do."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from chapters.ch08.mesh_layers import vulkan as mesh_layers
from chapters.ch08.settings import Settings
from chapters.ch08.shadows.lists import BY_MESH_SHADERS, target_size
from common.numerics.transforms import pose_looking_at
from common.scene import Image, Light, Material
from common.settings import replaced
from tests.support.buffers import read_words
from tests.support.lamps import lamps, lit
from tests.support.scenes import texture, translated
from tests.support.shadows import (
    all_faces,
    bending,
    commanded,
    faces_of,
    list_numbers,
    listed,
    read_face,
    words,
)
from tests.support.towns import KINDS, MASKED, ball, of_shapes, town, walk

pytestmark = pytest.mark.variants("vulkan")

SIZE = (64, 64)  # a power of two: no viewport rounds where a vertex lies, so whole pictures agree, too
BASE = Settings(
    anisotropy=1.0,
    default_light=False,
    shadow_memory="full",
    shadow_size=128,
    shadow_sun_size=256,
    shadow_cascades=2,
)
MESH, COMPUTE = {"geometry": "mesh"}, {"geometry": "compute"}
VIEW = walk()[0]
LAYERS = 8
"""The least number of layers that devices draw to at once, and that of the software driver."""


@pytest.fixture(autouse=True)
def has_mesh_shaders(chapter):
    for name in ("mesh-shader", "multi-draw"):
        if not chapter.device.has(name):
            pytest.skip(f"the device is used without {name}")


def mixed(count=60):
    """Return the town with meshes that are half of its waves: none of these is cut, since they share their indices.

    Commands draw them, and mesh shaders draw what else is of their material: balls, which are cut, and cubes.
    """
    made = town(count=count)
    half = made.meshes[2:3].copy()
    half["index_count"] = made.meshes["index_count"][2] // 6 * 3
    made.instances.mesh[np.flatnonzero(made.instances.mesh == 2)[::2]] = len(made.meshes)
    return replace(made, meshes=np.concatenate([made.meshes, half]), mesh_names=[*made.mesh_names, "half"])


def holes():
    """Return the town with a picture of stripes on all masked things, half of which are cut out."""
    raw = np.full((8, 8, 4), 255, np.uint8)
    raw[:, ::2, 3] = 0
    materials = list(KINDS)
    materials[MASKED] = Material(alpha_mode="mask", double_sided=True, base_color_texture=texture())
    return replace(town(count=120), materials=materials, images=[Image("stripes", pixels=raw)])


def lamp(kind, at, target=(0.0, 0.0, 0.0)):
    """Return a light of a kind, and its pose."""
    return Light(kind, 0, intensity=20.0, inner_cone=0.5, outer_cone=0.7), pose_looking_at(
        at, target, (0.3, 0.9, 0.2)
    )


def balls(middles, shape=None):
    """Return one thing of one material at each of some places."""
    return of_shapes(
        [shape or ball()], [0], np.zeros(len(middles), int), np.stack([translated(*at) for at in middles])
    )


def under(scene, *lights):
    """Return a scene with these lights and no other."""
    numbered = [replace(light, node=number) for number, (light, _) in enumerate(lights)]
    return lit(scene, numbered, np.array([pose for _, pose in lights]))


POINT, SPOT, SUN = (
    lamp("point", (1.0, 3.0, 2.0)),
    lamp("spot", (-8.0, 5.0, 3.0)),
    lamp("directional", (3.0, 9.0, 4.0)),
)
SCENES = {
    "sun": lambda: under(town(count=120), SUN),
    "spot": lambda: under(town(count=120), SPOT),
    "point": lambda: under(town(count=120), POINT),
    "masked": lambda: under(holes(), SUN, POINT),
    "many": lambda: lit(mixed(120), *lamps(12, directional=1)),
    "deforming": bending,
    "whole": lambda: under(balls([(x, 0.0, 0.0) for x in (0.0, 3.0, 6.0)], ball(3, 4)), SUN),
}


def shadows(renderer):
    return renderer.techniques["shadows"].passes["shadows"]


def drawn(chapter, scene, views=(VIEW,), without=(), **knobs):
    """Return the maps and the picture after each of some views, and the pass."""
    found = []
    with chapter.open(scene, SIZE, replaced(BASE, **knobs), without=without) as renderer:
        for view in views:
            picture = renderer.render(view).image("color")
            found.append((all_faces(renderer), picture))
        return found, shadows(renderer)


def assert_same(one, other):
    for (pages, picture), (others, its) in zip(one, other, strict=True):
        assert np.array_equal(pages, others) and np.array_equal(picture, its)


@pytest.mark.feature("shadows/mesh-shader-layers", "shadows/per-face-fallback")
@pytest.mark.parametrize(
    "kind",
    [
        pytest.param(kind, marks=[pytest.mark.long] * (kind in ("sun", "spot", "point", "masked")))
        for kind in SCENES
    ],
)
def test_layers_hold_the_bits_of_maps_that_are_drawn_face_by_face(chapter, kind):
    scene = SCENES[kind]()
    layered, own = drawn(chapter, scene, **MESH)
    faces, other = drawn(chapter, scene, without=("mesh-shader",), **COMPUTE)
    assert own.layered is not None and other.layered is None
    assert (layered[0][0] < 1e29).mean() > 0.001
    assert_same(layered, faces)
    lists = own.lists
    assert lists.by_mesh_shaders.any() == (kind != "deforming")
    if kind == "many":  # batches of both kinds in one target, and lights of which a round draws some faces
        assert lists.by_commands.any() and (lists.by_commands & lists.by_mesh_shaders).any()
        assert max(turn.layers for turn in own.schedule.rounds) <= own.lists.layers
        used = own.schedule.lists[own.schedule.lists > 0]
        assert own.lists.layers > LAYERS or len(np.unique(used)) < len(used)


@pytest.mark.feature("shadows/mesh-shader-layers")
@pytest.mark.parametrize(
    "knobs",
    [
        pytest.param({"shadow_memory": "pages", "shadow_detail": 0.05}, marks=pytest.mark.long),
        pytest.param({"shadow_sides": "front"}, marks=pytest.mark.long),
    ],
)
def test_sizes_and_sides_change_nothing_about_that(chapter, knobs):
    scene = lit(town(count=120), *lamps(9, directional=1))
    layered, _ = drawn(chapter, scene, walk()[:2], **MESH, **knobs)
    faces, _ = drawn(chapter, scene, walk()[:2], **COMPUTE, **knobs)
    assert_same(layered, faces)


@pytest.mark.feature("shadows/mesh-shader-layers")
def test_each_face_of_a_light_has_the_ball_on_its_side(chapter):
    """Balls of radius 1 on the six sides of two lamps: the nearest texel of each face is 1 metre before a middle."""
    at = np.array([(0.0, 0.0, 0.0), (100.0, 0.0, 0.0)])
    axes = np.array([(1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0), (0, 0, 1), (0, 0, -1)], np.float64)
    away = np.array([2.0, 2.5, 3.0, 3.5, 4.0, 4.5]) + np.array([[0.0], [0.25]])
    middles = (at[:, None] + axes * away[..., None]).reshape(-1, 3)
    scene = balls(middles)
    scene.bounds = np.stack([middles.min(axis=0) - 1, middles.max(axis=0) + 1])
    lights = [(Light("point", 0, intensity=20.0, range=20.0), translated(*place)) for place in at]
    view = replace(VIEW, world_from_view=pose_looking_at((50.0, 0.0, 90.0), (50.0, 0.0, 0.0)))
    with chapter.open(under(scene, *lights), SIZE, replaced(BASE, **MESH)) as renderer:
        work = renderer.render(view).work
        faces, own = faces_of(renderer), shadows(renderer)
        assert own.lists.by_mesh_shaders.all() and not own.lists.by_commands.any()
        # One call for all faces of a round, of which there are two on the software driver: 8 and 4.
        assert work["shadow_draw_calls"] == len(own.schedule.rounds) == -(-12 // min(12, own.lists.layers))
        nearest = np.array([read_face(renderer, number).min() for number in range(12)])
    order = np.argsort(np.abs(faces["origin"][::6, 0] - (at - renderer.scene.origin)[:, :1]).argmin(axis=0))
    expected = away[order].reshape(-1) - 1.0
    # The texel next to the axis is off it by at most 0.012 of the distance, where the ball is hardly lower.
    assert (nearest >= expected - 1e-4).all() and (nearest - expected < 0.02 * expected + 0.005).all()


@pytest.mark.feature("shadows/mesh-shader-layers")
def test_groups_cover_lists_of_any_length_and_know_their_layers(chapter, monkeypatch):
    """The rows of the last round, made again from its lists: groups of 32 entries, and a layer for each face."""
    monkeypatch.setattr(mesh_layers, "most_layers", lambda device: 5)
    upwards = lamp("spot", (0.0, 9.0, 0.0), (0.0, 20.0, 0.0))
    scene = under(town(count=300), POINT, SPOT, upwards, lamp("spot", (6.0, 2.0, -7.0)))
    knobs = {"shadow_cull_instances": False, "shadow_cull_meshlets": False}
    with chapter.open(scene, SIZE, replaced(BASE, **MESH, **knobs)) as renderer:
        renderer.render(VIEW).image("color")
        own, numbers = shadows(renderer), words(renderer, "numbers")
        lists, turn = own.lists, own.schedule.rounds[-1]
        layers, batches = lists.layers, lists.batches
        read = read_words(renderer.device, own.layered._memory._buffer("rows"))
        rows = read.reshape(batches, 1 + layers, 4).astype(np.int64)
        units = numbers[layers * batches : 2 * layers * batches].reshape(layers, batches).T[:, : turn.layers]
    assert [turn.layers for turn in own.schedule.rounds] == [
        5,
        4,
    ]  # the first light goes on in the second round
    groups = -(-units.astype(np.int64) // 32)
    assert (units % 32 != 0).any() and (groups > 1).any()
    used = np.flatnonzero(own.schedule.lists[turn.first :])
    assert len(used) < turn.layers or (units[:, used[1:-1]] == 0).any()  # an empty list between others
    assert np.array_equal(rows[:, 1 : 1 + turn.layers, 0], np.cumsum(groups, axis=1) - groups)
    total = groups.sum(axis=1)
    assert np.array_equal(rows[:, 0], np.stack([total, total > 0, np.ones_like(total), total], axis=1))
    for layer, word in enumerate(own.schedule.drawn[turn.first : turn.first + turn.layers].tolist()):
        face, number = word >> 12 & 15, (word >> 16) - turn.first
        row = rows[:, 1 + number]
        assert (row[:, 3] >> face & 1 == 1).all()
        assert (row[:, 1 + face // 4] >> 8 * (face % 4) & 255 == layer).all()
    marked = sum(int(mask).bit_count() for mask in rows[0, 1 : 1 + turn.layers, 3])
    assert marked == turn.layers


@pytest.mark.feature("shadows/mesh-shader-layers", "shadows/cull-toggles")
@pytest.mark.parametrize(
    "off",
    [
        "",
        "faces",
        *(pytest.param(name, marks=pytest.mark.long) for name in ("cones", "instances", "meshlets")),
    ],
)
def test_toggles_change_the_counts_of_both_paths_alike(chapter, off):
    scene = under(mixed(), POINT, SPOT, lamp("spot", (6.0, 2.0, -7.0)))
    found, flags = [], None
    for path in (MESH, COMPUTE):
        knobs = {f"shadow_cull_{off}": False} if off else {}
        with chapter.open(scene, SIZE, replaced(BASE, shadow_sides="front", **path, **knobs)) as renderer:
            renderer.render(VIEW).image("color")
            own = shadows(renderer)
            flags = flags if found else own.lists.tables.draws["flags"]  # of the path with mesh shaders
            assert len(own.schedule.rounds) == 1 and own.schedule.rounds[0].layers == LAYERS
            numbers = list_numbers(renderer)
            found.append((listed(renderer), commanded(renderer), all_faces(renderer)))
    (lists, few, maps), (others, commands, pages) = found
    assert all(np.array_equal(one, other) for one, other in zip(lists, others, strict=True))
    for layer, word in enumerate(own.schedule.drawn.tolist()):
        entries = lists[numbers.index(word >> 16)]
        seen = entries[(entries[:, 2] >> (word >> 12 & 15) & 1) == 1]
        by_commands = (flags[seen[:, 0]] & BY_MESH_SHADERS) == 0
        assert len(few[layer]) == by_commands.sum() and len(commands[layer]) == len(seen)
    assert 0 < sum(map(len, few)) < sum(map(len, commands))
    assert np.array_equal(maps, pages)


@pytest.mark.feature("shadows/per-face-fallback")
@pytest.mark.parametrize("most", [pytest.param(1, marks=pytest.mark.long), 3])
def test_a_device_with_fewer_layers_draws_the_same_maps(chapter, monkeypatch, most):
    scene = lit(town(count=40), *lamps(6, directional=1))
    every, _ = drawn(chapter, scene, **MESH)
    monkeypatch.setattr(mesh_layers, "most_layers", lambda device: most)
    few, own = drawn(chapter, scene, **MESH)
    assert_same(every, few)
    assert (own.layered is None) == (most == 1)
    assert most == 1 or max(turn.layers for turn in own.schedule.rounds) == most


@pytest.mark.feature("shadows/mesh-shader-layers")
def test_a_lamp_that_moves_and_things_that_hide_leave_both_paths_alike(chapter):
    pictures = []
    for path in (MESH, COMPUTE):
        scene = under(town(count=40), SUN, POINT, SPOT)
        taken = []
        with chapter.open(scene, SIZE, replaced(BASE, **path)) as renderer:

            def take(renderer=renderer, taken=taken):
                frame = renderer.render(VIEW)
                taken.append((all_faces(renderer), frame.image("color")))
                return frame.work.get("shadow_faces_drawn", 0)

            assert take() == 9 and take() == 0
            for name in (1, 2):
                with renderer.scene.edit() as edit:
                    edit.set_transform(scene.lights[name].node, matrix=translated(0.5, 2.5, name))
                assert take() == (6 if name == 1 else 1)
            with renderer.scene.edit() as edit:
                edit.set_visible(0, False)
                edit.set_visible(7, False)
            assert take() == 9 and take() == 0
        pictures.append(taken)
    assert_same(*pictures)
    assert not np.array_equal(pictures[0][0][0], pictures[0][-1][0])


def test_targets_are_the_least_powers_of_two():
    assert [target_size(size) for size in (40, 128, 136, 256, 2048)] == [64, 128, 256, 256, 2048]
