"""Casters that move: which faces they touch, and pages in which they are drawn over what stands still."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from chapters.ch08.movers.model import Movers, touched
from chapters.ch08.scene.packing import LIGHT, LIGHT_KINDS
from chapters.ch08.settings import Settings
from chapters.ch08.shadows import faces as face_model
from chapters.ch08.shadows.faces import FACE
from common.numerics.transforms import pose_looking_at
from common.settings import replaced
from common.view.camera import Orthographic, Perspective, View
from tests.support.cloth_scenes import cloth, cloth_scene_of
from tests.support.shadows import PLAIN, bending, point, spot, sun, yard

pytestmark = pytest.mark.variants("vulkan", "gl")

SIZE = (64, 64)
BASE = Settings(
    **PLAIN,
    shadow_sun_size=256,
    shadow_size=256,
    shadow_cascades=1,
    shadow_detail=16.0,
)
ABOVE = View(pose_looking_at((0, 6, 0), (0, 0, 0), (0, 0, -1)), Orthographic(3.0, 0.1, 20.0))
ASIDE = View(pose_looking_at((3, 4, 5), (0, 0.3, 0)), Perspective())
SUN, SPOT, POINT = sun((0.5, -1.0, 0.3)), spot((1.5, 4.0, 1.0), (0.0, 0.5, 0.0)), point((-1.2, 3.0, 0.8))


def settled(renderer, view, time=0.0):
    for _ in range(30):
        frame = renderer.render(view, time)
        picture = frame.image("color_linear").copy()
        if renderer.techniques["shadows"].resting(0.0):
            return picture
    raise AssertionError("shadows come to no rest")


def lift(scene, by):
    """Move the first side of the cube, and so its shadow."""
    matrix = scene.nodes.matrix[1].copy()
    matrix[:3, 3] += by
    with scene.edit() as edit:
        edit.set_transform(1, matrix=matrix)


@pytest.mark.feature("shadows/caching")
def test_boxes_touch_the_faces_that_see_any_of_their_points():
    random = np.random.default_rng(4)
    lights = np.zeros(3, LIGHT)
    lights["kind"] = [LIGHT_KINDS["point"], LIGHT_KINDS["spot"], LIGHT_KINDS["point"]]
    lights["position"] = random.uniform(-3, 3, (3, 3))
    lights["direction"] = (0, 0, -1)
    lights["cone"][:, 0], lights["cone"][:, 1] = 4.0, -3.0
    records, *_ = face_model.local_faces(
        lights, np.arange(3), np.full(3, 128), 0.01, np.array([4.0, 5.0, 1.5]), np.full(3, 2)
    )
    records = np.concatenate([records, np.zeros(2, FACE)])
    used = np.r_[np.ones(len(records) - 2, bool), False, False]
    missed = extra = 0
    for _ in range(100):
        low = random.uniform(-6, 5, 3)
        box = np.stack([low, low + random.uniform(0.1, 2.0, 3)])
        found = touched(records, used, box[None])
        points = random.uniform(box[0], box[1], (3000, 3))
        truth = np.zeros(len(records), bool)
        for number, face in enumerate(records[:-2]):
            axes = np.stack([face["right"], face["down"], face["ahead"]]).astype(np.float64)
            p = (points - face["origin"]) @ axes.T
            wide = 64 / float(face["scale_x"])
            seen = (np.abs(p[:, :2]) < wide * p[:, 2:]).all(axis=1) & (p[:, 2] > face["near"])
            seen &= np.linalg.norm(points - face["origin"], axis=1) < face["far"]
            truth[number] = seen.any()
        missed += (truth & ~found).sum()
        extra += (found & ~truth).sum()
    assert missed == 0 and extra < 0.05 * 100 * 13
    # Many boxes are tested against the reach of lights alone.
    low = random.uniform(-6, 5, (3000, 3))
    many = np.stack([low, low + 0.2], axis=1)
    found = touched(records, used, many[:1000]) | touched(records, used, many[1000:])
    assert (touched(records, used, many) >= found).all() and not touched(records, used, many + 100.0).any()
    assert touched(records, used, np.full((1, 2, 3), np.nan)).tolist() == used.tolist()
    assert not touched(records, used, np.zeros((0, 2, 3))).any()


def test_what_has_moved_once_is_followed_from_then_on():
    records = np.zeros(
        3, [("world_from_object", "f4", (3, 4)), ("bounds_centre", "f4", 4), ("bounds_extent", "f4", 4)]
    )
    records["bounds_centre"][:, 0], records["bounds_extent"][:, :3] = (0.0, 10.0, 20.0), 1.0
    movers = Movers(np.array([False, False, True]))
    joined, before, now, moved = movers.follow(records, 1, True, {})  # the first frame moves nothing
    assert not moved and not len(joined) and not len(now)
    other = records.copy()
    other["world_from_object"][1, 0, 3] = 1.0
    other["bounds_centre"][1, 0] = 11.0
    joined, before, now, moved = movers.follow(other, 2, False, {})
    assert moved and movers.moving.tolist() == [False, True, False]
    assert joined[0, :, 0] == pytest.approx([9, 11], abs=1e-3)
    assert np.array_equal(before, joined) and now[0, :, 0] == pytest.approx([10, 12], abs=1e-3)
    joined, before, now, moved = movers.follow(other, 2, False, {})
    assert not moved and not len(joined) and np.array_equal(before, now)
    # What deforms has a box only if something else knows it.
    *_, now, moved = movers.follow(other, 2, True, {})
    assert moved and np.isnan(now[1]).all()
    box = np.array([(0.0, 0, 0), (1, 1, 1)])
    *_, before, now, moved = movers.follow(other, 2, True, {2: box})
    assert np.isnan(before[1]).all() and np.array_equal(now[1], box)


@pytest.mark.feature("shadows/caching")
@pytest.mark.parametrize("without", [(), ("multi-draw",), pytest.param(("sparse",), marks=pytest.mark.long)])
def test_movers_are_drawn_over_what_stands_still(chapter, without):
    """All pictures of a walk equal those of maps that are drawn anew as a whole."""
    scene, whole = yard(SUN, SPOT, POINT), yard(SUN, SPOT, POINT)
    full = replaced(BASE, shadow_memory="full")
    with (
        chapter.open(scene, SIZE, BASE, without=without, outputs=("color_linear",)) as renderer,
    ):
        settled(renderer, ASIDE)
        technique = renderer.techniques["shadows"]
        for step in range(2):
            by = np.array((0.1, 0.05, 0.0)) * (1 if step == 0 else -20)
            lift(scene, by)
            lift(whole, by)
            moved = renderer.render(ASIDE)
            picture = settled(renderer, ASIDE)
            with chapter.open(whole, SIZE, full, outputs=("color_linear",)) as other:
                assert np.array_equal(picture, other.render(ASIDE).image("color_linear")), step
            rounds = technique.passes["shadows"].schedule.rounds
            assert moved.work["shadow_faces_drawn"] > 0 and rounds == ()
        lift(scene, (0.1, 0.0, 0.0))
        again = renderer.render(ASIDE)
        rounds = technique.passes["shadows"].schedule.rounds
        if "multi-draw" not in without:
            assert all(turn.movers for turn in rounds)  # what stands still is not drawn again
            assert technique.lights.pool.used > again.work["shadow_pages"] / 2
        still = renderer.render(ASIDE)
        assert still.work["shadow_faces_drawn"] == 0


def test_only_lights_that_movers_meet_are_drawn_again(chapter):
    near = point((-1.2, 3.0, 0.8), reach=6.0)
    far = point((3.5, 0.5, 3.5), reach=1.0)
    scene = yard(near, far)
    with chapter.open(scene, SIZE, BASE, outputs=("color_linear",)) as renderer:
        settled(renderer, ASIDE)
        lift(scene, (0.1, 0.0, 0.0))
        renderer.render(ASIDE)
        technique = renderer.techniques["shadows"]
        drawn = technique.faces["light"][technique.passes["shadows"].schedule.faces]
        assert set(drawn.tolist()) == {0}


def test_a_pool_without_room_draws_both_kinds_of_casters_into_one_tile(chapter):
    scene, whole = yard(SUN, POINT), yard(SUN, POINT)
    turned = replaced(BASE, shadow_size=128, shadow_pool=1)
    pictures = []
    with chapter.open(scene, SIZE, turned, outputs=("color_linear",)) as renderer:
        settled(renderer, ASIDE)
        for _ in range(3):
            lift(scene, (0.1, 0.05, 0.0))
            lift(whole, (0.1, 0.05, 0.0))
            pictures.append(settled(renderer, ASIDE))
        sizes = renderer.techniques["shadows"].lights.lamps.sizes.copy()
    roomy = replaced(turned, shadow_pool=64, shadow_size=max(128, int(sizes.max())))
    with chapter.open(whole, SIZE, roomy, outputs=("color_linear",)) as renderer:
        assert np.abs(settled(renderer, ASIDE) - pictures[-1]).mean() < 0.05 * pictures[-1].mean()


@pytest.mark.parametrize("kind", ["bending", "cloth"])
def test_what_deforms_equals_maps_that_are_drawn_anew(chapter, kind):
    looking = View(pose_looking_at((0, 1, 6), (0, 0, 0)), Perspective())
    pictures = []
    for memory in ("pages", "full"):
        scene = bending() if kind == "bending" else cloth_scene_of(cloth())
        if kind == "cloth":
            scene = replace(scene)
        turned = replaced(BASE, shadow_size=128, shadow_sun_size=128 * 2, shadow_memory=memory)
        with chapter.open(scene, SIZE, turned, outputs=("color_linear",)) as renderer:
            for time in (0.0, 0.2, 0.4, 0.6, 0.6, 0.6, 0.6):
                picture = renderer.render(looking, time).image("color_linear").copy()
            pictures.append(picture)
    assert np.array_equal(*pictures) and pictures[0].max() > 0
