"""Lighting from lists equals brute force in every bit, on every path, and so do the limits of lights."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from chapters.ch07.clusters.lights import LightRecords
from chapters.ch07.settings import Settings
from common.errors import SettingError
from common.images.palette import heat
from common.numerics.transforms import pose_looking_at
from common.scene import Light
from common.settings import apply_overrides, preset, replaced
from common.view.camera import Orthographic, Perspective, View
from tests.support.lamps import lamps, lit, lit_town
from tests.support.scenes import nodes_at, quad_scene, translated
from tests.support.towns import town, walk

SIZE = (61, 35)
EXACT = Settings(
    color_format="rgba32f",
    gbuffer_format="full",
    anisotropy=1.0,
    ambient=0.0,
    background=0.0,
    default_light=False,
)


def pictures(chapter, scene, views, size=SIZE, **turned):
    with chapter.open(scene, size, replaced(EXACT, **turned), outputs=("color_linear",)) as renderer:
        return [renderer.render(view).image("color_linear").copy() for view in views]


def assert_equal(chapter, scene, views, lists=("clusters",), size=SIZE, **turned):
    wanted = pictures(chapter, scene, views, size, light_lists="brute", **turned)
    for name in lists:
        drawn = pictures(chapter, scene, views, size, light_lists=name, **turned)
        for number, (one, other) in enumerate(zip(drawn, wanted, strict=True)):
            assert np.array_equal(one, other), f"{name}, view {number}"
            assert np.isfinite(one).all()
    return wanted


@pytest.mark.feature("clustered/lighting-loop")
@pytest.mark.parametrize(
    "count",
    [
        *(0, pytest.param(1, marks=pytest.mark.long), pytest.param(32, marks=pytest.mark.long)),
        *(pytest.param(33, marks=pytest.mark.core), pytest.param(256, marks=pytest.mark.long)),
    ],
)
def test_lists_give_the_bits_of_brute_force(chapter, count):
    wanted = assert_equal(chapter, lit_town(count, directional=count // 20), walk()[1::6])
    assert (max(picture.max() for picture in wanted) > 0) == (count > 0)


@pytest.mark.feature("clustered/lighting-loop")
@pytest.mark.parametrize("graph", ["compute", "forward", pytest.param("deferred", marks=pytest.mark.long)])
def test_each_path_and_each_kind_of_list(chapter, graph):
    assert_equal(chapter, lit_town(70), walk()[::6], ("bins", "tiles"), graph=graph)


@pytest.mark.feature("clustered/lighting-loop")
@pytest.mark.newest
def test_2400_lights(chapter):
    assert_equal(chapter, lit_town(2400), walk()[:1], size=(24, 14))


@pytest.mark.feature("clustered/scalarised-loop")
@pytest.mark.parametrize("graph", ["compute", "forward"])
def test_a_loop_in_step_gives_the_bits_of_the_plain_one(chapter, graph):
    """Without arithmetic in subgroups the plain loop runs, so the picture is its picture there, too."""
    scene, views = lit_town(70, directional=2), walk()[::6]
    for lists in ("clusters",):
        plain = pictures(chapter, scene, views, light_lists=lists, graph=graph)
        settings = replaced(EXACT, light_lists=lists, graph=graph, light_loop="scalarised")
        with chapter.open(scene, SIZE, settings, outputs=("color_linear",)) as renderer:
            assert (("SCALARISED", 1) in renderer._pipelines._defines) == renderer.plan.native("subgroups")
            for view, wanted in zip(views, plain, strict=True):
                assert np.array_equal(renderer.render(view).image("color_linear"), wanted)


@pytest.mark.feature("clustered/scalarised-loop")
def test_a_loop_that_is_not_there_is_refused():
    with pytest.raises(SettingError, match="light_loop"):
        apply_overrides(Settings(), ["light_loop=unrolled"])


@pytest.mark.parametrize("size", [(1, 1), (65, 33)])
def test_sizes_that_tiles_do_not_divide(chapter, size):
    assert_equal(chapter, lit_town(40), walk()[:1], size=size)


def test_an_orthographic_view_and_a_wide_one(chapter):
    views = [
        View(pose_looking_at((9.0, 6.0, 9.0), (0.0, 0.0, 0.0)), Orthographic(6.0, 0.0, 60.0)),
        View(pose_looking_at((3.0, 1.0, 3.0), (0.0, 1.0, 0.0)), Perspective(3.0, 0.001)),
    ]
    assert_equal(chapter, lit_town(70), views)


def test_the_same_lists_after_a_resize(chapter):
    scene, view = lit_town(70), walk()[0]
    wanted = pictures(chapter, scene, [view], (64, 40), light_lists="brute")[0]
    with chapter.open(scene, SIZE, EXACT, outputs=("color_linear",)) as renderer:
        renderer.render(view)
        renderer.resize((64, 40))
        for _ in range(5):  # sets of before are freed when both slots have been used again
            assert np.array_equal(renderer.render(view).image("color_linear"), wanted)


def test_edits_and_moving_lights_are_followed(chapter):
    """A light becomes directional, another one moves and is dimmed: the lists are those of the edited scene."""
    views, drawn = [walk()[0]], {}
    for lists in ("clusters", "brute"):
        scene = lit_town(40)
        settings = replaced(EXACT, light_lists=lists)
        with chapter.open(scene, SIZE, settings, outputs=("color_linear",)) as renderer:
            before = renderer.render(views[0]).image("color_linear").copy()
            with scene.edit() as edit:
                edit.set_light(3, replace(scene.lights[3], kind="directional", intensity=0.2))
                edit.set_light(5, replace(scene.lights[5], range=20.0, kind="point", intensity=9.0))
            drawn[lists] = renderer.render(views[0]).image("color_linear").copy()
            assert not np.array_equal(before, drawn[lists])
    assert np.array_equal(drawn["clusters"], drawn["brute"])


# --- lights at the ends of what numbers can be ---


@pytest.mark.parametrize("scale", [1e-3, pytest.param(1e3, marks=pytest.mark.long)])
def test_radii_from_a_thousandth_to_a_hundred_thousand(chapter, scale):
    """Lights at, behind and beyond the eye, in scenes of all sizes; 1e5 m beyond the farthest surface, too."""
    view = walk()[0]
    eye, ahead = view.world_from_view[:3, 3], -view.world_from_view[:3, 2]
    lights, poses = lamps(12)
    for number, (radius, along) in enumerate(
        (r, a) for r in (1e-3, 1.0, 1e5) for a in (-1e5, -2.0, 0.0, 0.05, 3.0, 1e5)
    ):
        lights.append(Light("point", 12 + number, range=radius * scale, intensity=scale * scale))
        pose = np.eye(4)
        pose[:3, 3] = eye + along * ahead
        poses = np.concatenate([poses, pose[None]])
    scene = lit(town(), lights, poses)
    grow = np.diag((scale, scale, scale, 1.0))
    scene = replace(scene, nodes=nodes_at(*(grow @ matrix for matrix in scene.nodes.matrix)))
    pose = view.world_from_view.copy()
    pose[:3, 3] *= scale
    grown = View(pose, Perspective(0.9, 0.05 * scale))
    wanted = assert_equal(chapter, scene, [grown])
    assert wanted[0].max() > 0


@pytest.mark.long
def test_a_world_far_away_has_the_same_lists(chapter):
    away = np.eye(4)
    away[:3, 3] = (1e5, -3e4, 2e5)
    near = lit_town(70)
    far = replace(near, nodes=nodes_at(*(away @ matrix for matrix in near.nodes.matrix)))
    views = [View(away @ view.world_from_view, view.projection) for view in walk()[:1]]
    assert_equal(chapter, far, views)


# --- which lights there are ---


def test_a_light_ends_where_its_illuminance_falls_to_the_cutoff(chapter):
    """A plane of albedo 1 under one lamp: E = I cos(t) / d^2 within d = sqrt(I / cutoff), exactly 0 beyond."""
    lamp = Light("point", node=1, intensity=2.0)
    base = quad_scene(matrices=(np.diag((20.0, 20.0, 1.0, 1.0)),))
    pose = np.eye(4)
    pose[:3, 3] = (0.0, 0.0, 1.0)
    scene = lit(base, [replace(lamp, node=0)], pose[None])
    view = View(pose_looking_at((0.0, 0.0, 8.0), (0.0, 0.0, 0.0)), Orthographic(5.0, 0.1, 20.0), ev100=3.0)
    cutoff = 0.125  # lux: the lamp ends 4 m away, sqrt(15) m from the middle of the picture
    (picture,) = pictures(chapter, scene, [view], (64, 64), light_cutoff=cutoff)
    place = (np.arange(64) + 0.5) * 10.0 / 64 - 5.0
    distance2 = place[:, None] ** 2 + place[None] ** 2 + 1.0
    lit_up = picture.max(axis=2) > 0
    assert np.array_equal(lit_up, distance2 < 2.0 / cutoff), "the setting is in lux: exposure plays no part"
    (whole,) = pictures(chapter, scene, [view], (64, 64), light_cutoff=0.0)
    assert (whole.max(axis=2) > 0).all()
    assert np.array_equal(picture[lit_up], whole[lit_up])


def test_the_default_cutoff_is_above_zero():
    assert Settings().scene.light_cutoff > 0


@pytest.mark.feature("clustered/lighting-loop")
def test_of_too_many_lights_the_brightest_are_kept(chapter):
    """Directional lights come first, then the strongest; one sentence says how many are left out."""
    lights, poses = lamps(50, directional=2)
    scene = lit(town(), lights, poses)
    strength = [light.intensity * max(light.color) for light in lights]
    local = sorted(range(2, 50), key=lambda number: -strength[number])[:18]
    few = lit(town(), [replace(lights[n], node=n) for n in (0, 1, *sorted(local))], poses)
    wanted = pictures(chapter, few, walk()[:1])[0]
    settings = replaced(EXACT, most_lights=20)
    with chapter.open(scene, SIZE, settings, outputs=("color_linear",)) as renderer:
        frame = renderer.render(walk()[0])
        assert np.array_equal(frame.image("color_linear"), wanted)
        assert frame.work["lights"] == 20 and frame.work["lights_left_out"] == 30
        (sentence,) = [text for text in renderer.scene.warnings if "brightest" in text]
        assert "50 lights" in sentence and "30 are left out" in sentence and sentence.count(".") == 1


def test_the_books_preset_has_the_books_limit():
    assert preset(Settings, "book").clusters.most_lights == 256
    assert preset(Settings, "medium").clusters.most_lights == 4096


def test_a_moving_camera_packs_no_light():
    """Records are packed for an edit; a pose costs whole arrays, whatever the number of lights."""
    scene = lit_town(300)
    records = LightRecords(scene, 0.001, 4096)
    records.follow()
    packed_once = records._records
    records.follow()
    assert records._records is packed_once
    with scene.edit() as edit:
        edit.set_light(0, replace(scene.lights[0], intensity=5.0))
    records.follow()
    assert records._records is not packed_once


@pytest.mark.feature("clustered/lighting-loop", "clustered/tile-bitfields")
@pytest.mark.parametrize(
    ("size", "degrees"),
    [((3, 3), 120.0), pytest.param((7, 5), 120.0, marks=pytest.mark.long), ((9, 9), 150.0)],
)
def test_tiles_that_span_more_than_a_cone(chapter, size, degrees):
    """The picture is one tile or few, and its corners are 90 degrees and more from the middle of a tile."""
    reach = np.tan(np.radians(degrees / 2)) / 6
    places = np.stack(np.meshgrid(*[(np.arange(12) - 5.5) * reach] * 2), axis=-1).reshape(-1, 2)
    lights = [Light("point", node=number, range=0.8 * reach) for number in range(len(places))]
    wall = quad_scene(matrices=(np.diag((40.0, 40.0, 1.0, 1.0)),))
    scene = lit(wall, lights, np.array([translated(x, y, 0.05) for x, y in places]))
    view = View(pose_looking_at((0.0, 0.0, 1.0), (0.0, 0.0, 0.0)), Perspective(np.radians(degrees), 0.01))
    (wanted,) = assert_equal(chapter, scene, [view], ("tiles", "clusters"), size)
    assert (wanted.max(axis=-1) > 0).mean() > 0.5


@pytest.mark.feature("clustered/lighting-loop")
def test_views_count_lights_in_range_and_lights_evaluated(chapter):
    """Brute force evaluates all lights at every lit pixel, lists none fewer than reach it; white is `view_white`."""
    scene, view, counts = lit_town(70), walk()[0], {}
    for name, lists in (
        ("light-count", "brute"),
        ("lights-evaluated", "brute"),
        ("lights-evaluated", "clusters"),
    ):
        settings = replaced(EXACT, view=name, light_lists=lists, view_white=35)
        with chapter.open(scene, SIZE, settings, outputs=("color", "color_linear")) as renderer:
            frame = renderer.render(view)
            counts[name, lists] = frame.image("color_linear")[..., 0].copy()
            codes = frame.image("color")[..., :3] / 255.0
        shown = counts[name, lists] >= 0
        np.testing.assert_allclose(codes[shown], heat(counts[name, lists][shown] / 35), atol=0.51 / 255)
    reached, every, named = counts.values()
    lit_pixels = every > 0
    assert lit_pixels.mean() > 0.3 and (every[lit_pixels] == 70).all()
    assert (named >= reached)[lit_pixels].all() and named[lit_pixels].max() < 70
    assert reached[lit_pixels].max() > 0
