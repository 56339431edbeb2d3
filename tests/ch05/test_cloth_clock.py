"""Which steps a frame simulates, of which cloths, and whose vertices it writes: decided without a GPU."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from chapters.ch05.cloth.frames import ClothFrames, drawn_from
from chapters.ch05.cloth.layout import CLOTH_FRAME, GLOBALS, STATS, WRITE
from chapters.ch05.cloth.scene import cloth_scene
from chapters.ch05.cloth.settings import ClothSettings
from chapters.ch05.cloth.steps import CALM_SECONDS, ClothClock
from chapters.ch05.scene.pages import plan_pages
from common.numerics.transforms import pose_looking_at, translation
from common.view.camera import Perspective, View
from tests.support.cloth_runs import posed
from tests.support.cloth_scenes import cloth, cloth_scene_of

SPHERE = {"shape": "sphere", "radius_m": 1.0}


def test_steps_follow_from_time_alone():
    """Frames of 1/60 and of 1/30 s have made the same steps at the same time; a step is due at its time exactly."""
    fast, slow = ClothClock(1, 1 / 60), ClothClock(1, 1 / 60)
    assert fast.frame(0.0, "first frame", ()).count == 0 and fast.began
    assert [fast.frame(k / 60, "", ()).count for k in range(1, 121)] == [1] * 120
    assert [slow.frame(k / 30, "", ()).count for k in range(61)] == [0] + [2] * 60
    assert fast.done == slow.done == 120
    summed, time = ClothClock(1, 1 / 60), 0.0
    for _ in range(600):
        time += 1 / 60  # each sum is rounded, and many fall short
        assert summed.frame(time, "", ()).count == 1


def test_a_hitch_is_clamped_and_time_that_runs_back_begins_anew():
    clock = ClothClock(1, 1 / 60)
    clock.frame(0.0, "first frame", ())
    due = clock.frame(1.0, "", ())
    assert (due.count, due.skipped) == (15, 45) and clock.done == 60
    assert clock.frame(1.0 + 1 / 60, "", ()).count == 1
    assert clock.frame(0.5, "time ran backwards", ()).count == 15 and clock.began and clock.done == 30
    assert clock.frame(-5.0, "time ran backwards", ()).count == 0 and clock.done == 0
    for goes_on in ("resize", "camera cut"):
        clock.frame(0.0, goes_on, ())
        assert not clock.began
    for back in (
        "resize",
        "camera cut",
    ):  # a frame has one reason for having no history, and there may be two
        clock.frame(1.0, "", ())
        assert clock.frame(0.5, back, ()).count == 15 and clock.began and clock.done == 30


def test_a_cloth_rests_after_it_was_calm_for_a_while_and_wakes_when_something_changes():
    clock, yes, no = ClothClock(2, 1 / 60), np.array((True, True)), np.array((True, False))
    clock.frame(0.0, "first frame", "wind 0")
    for k in range(1, 100):
        clock.frame(k / 60, "", "wind 0")
        clock.told(clock.mark(), yes, no)
        assert clock.at_rest.tolist() == [k / 60 >= CALM_SECONDS, False]
    clock.frame(100 / 60, "", "wind 1")
    assert not clock.at_rest.any()
    stale = clock.mark()
    clock.frame(0.0, "time ran backwards", "wind 1")
    clock.told(stale, yes, yes)
    assert not clock.at_rest.any(), "what an earlier simulation was says nothing of this one"


VIEW = View(pose_looking_at((0, -0.5, 3), (0, -0.5, 0)), Perspective(np.radians(60), 0.1))


def frames_of(scene, settings=None):
    found = cloth_scene(scene)
    planned = plan_pages(found.scene, ["positions", "normals"])
    return found, ClothFrames(found, settings or ClothSettings(), drawn_from(found, planned))


def answer(frames, speed=0.0, lost=0.0):
    """Return what a GPU would write of all cloths: they hang where they are drawn first."""
    stats = np.zeros(len(frames.cloths), STATS)
    stats["low"], stats["high"] = (-0.5, -1, 0), (0.5, 0, 0)
    stats["speed_squared"], stats["not_finite"] = speed * speed, lost
    return stats.view(np.uint8)


def run(frames, found, k, view=VIEW, speed=0.0):
    """Return the plan of frame number k at 60 a second; what the frame before in its slot did had this speed."""
    frames.told(k % 2, answer(frames, speed))
    return frames.begin(
        k % 2,
        posed(found, k / 60),
        view,
        1.0,
        k / 60,
        "first frame" if k == 0 else "",
    )


def asked(plan):
    """Return the steps of each cloth, and whether its vertices are written."""
    rows = plan.arrays["frame"][GLOBALS.itemsize :].view(CLOTH_FRAME)
    return rows["run"][:, 0].tolist(), ((rows["run"][:, 1] & WRITE) > 0).tolist()


def test_each_slot_is_written_until_it_shows_the_state_and_then_nothing_is_left_to_do():
    found, frames = frames_of(cloth_scene_of(cloth()))
    first = run(frames, found, 0)
    assert not first.idle and first.count == 0 and first.work["cloth_steps"] == 0
    plans = [run(frames, found, k) for k in range(1, 60)]
    rested = next(k for k, plan in enumerate(plans) if plan.work["cloths_at_rest"])
    assert 0.5 <= rested / 60 < 0.6
    idle = [plan.idle for plan in plans]
    assert not any(idle[: rested + 1]) and all(idle[rested + 1 :]), "the other slot, once more"
    assert plans[rested].work["cloth_steps"] == 0 and plans[rested - 1].work["cloth_particles"] == 25
    assert not frames.busy(1e3) and frames.recorded(plans[-1]) is None


def test_a_first_frame_without_the_cloth_pass_writes_the_vertices_once():
    """In a file the cloth hangs at its node of time 0, and the first frame may be of another time."""
    found, frames = frames_of(cloth_scene_of(cloth()))
    plan = frames.pause(posed(found, 2.0), 2.0, "first frame")
    assert plan is not None and asked(plan) == ([0], [True])
    assert frames.pause(posed(found, 2.1), 2.1, "") is None, "all slots have these vertices"


def test_unseen_cloth_is_simulated_but_not_written():
    away = replace(VIEW, world_from_view=pose_looking_at((0, -0.5, 3), (0, -0.5, 9)))
    scene = cloth_scene_of(cloth())
    found, frames = frames_of(scene)
    for k in range(4):
        plan = run(frames, found, k, speed=1.0)
    assert asked(plan) == ([1], [True])
    assert asked(run(frames, found, 4, away, speed=1.0)) == ([1], [False])
    assert asked(run(frames, found, 5, speed=1.0)) == ([1], [True])
    with scene.edit() as edit:
        edit.set_visible(0, False)
    assert asked(run(frames, found, 6, speed=1.0)) == ([1], [False])


def test_a_cloth_that_was_just_outside_is_written_if_it_can_have_come_into_view():
    found, frames = frames_of(cloth_scene_of(cloth(pins=[])))
    for k in range(4):
        run(frames, found, k, speed=1.0)
    cases = ((0.02, 0.0, True), (0.6, 0.0, False), (0.6, 20.0, True), (2.0, 20.0, False))
    for outside, speed, written in cases:
        stats = answer(frames, speed)
        stats.view(STATS)["low"] = stats.view(STATS)["high"] = (
            -np.tan(np.radians(30)) * 3 - outside,
            -0.5,
            0,
        )
        k += 1
        frames.told(k % 2, stats)
        plan = frames.begin(k % 2, posed(found, k / 60), VIEW, 1.0, k / 60, "")
        assert asked(plan)[1] == [written], (outside, speed)


def test_a_cloth_that_begins_anew_is_where_it_begins_whatever_was_told_of_it_before():
    found, frames = frames_of(cloth_scene_of(cloth(pins=[])))
    for k in range(4):
        run(frames, found, k, speed=1.0)
    for slot, time in ((0, 0.0), (1, 1 / 60), (0, 1 / 30)):
        stats = answer(frames, 1.0)
        stats.view(STATS)["low"] = stats.view(STATS)["high"] = (100, 100, 100)  # before it began anew
        frames.told(slot, stats)
        reset = "time ran backwards" if time == 0.0 else ""
        assert asked(frames.begin(slot, posed(found, time), VIEW, 1.0, time, reset))[1] == [True]


def test_what_acts_on_a_cloth_wakes_it_and_what_it_looks_like_does_not():
    scene = cloth_scene_of(cloth(), colliders=[(SPHERE, translation((0, -9, 0)))])
    settings = ClothSettings()
    found, frames = frames_of(scene, settings)
    numbers = iter(range(10_000))

    def rest():
        for _ in range(80):
            plan = run(frames, found, next(numbers))
        assert plan.idle and plan.work["cloths_at_rest"] == 1

    def move(node):
        with scene.edit() as edit:
            edit.set_transform(node, matrix=translation((0, -8, node)))

    for change in (lambda: setattr(settings, "wind_speed", 3.0), lambda: move(0), lambda: move(1)):
        rest()
        change()
        plan = run(frames, found, next(numbers))
        assert plan.work["cloths_at_rest"] == 0 and plan.count == 1
    rest()
    with scene.edit() as edit:
        edit.set_material(0, replace(scene.materials[0], roughness=0.1))
        edit.set_transform(2, matrix=translation((5, 5, 5)))  # the sun
    assert run(frames, found, next(numbers)).idle


def test_a_frame_that_took_a_second_says_so_once():
    scene = cloth_scene_of(cloth())
    found, frames = frames_of(scene)
    run(frames, found, 0)
    skipped = [run(frames, found, k, speed=1.0).work["cloth_steps_skipped"] for k in (60, 61, 121)]
    assert skipped == [45, 0, 45]
    assert len([text for text in scene.warnings if "stood still" in text]) == 1


def test_a_first_frame_at_a_later_time_says_that_cloth_does_not_hang_as_it_would_by_then():
    for k, told in ((0, 0), (15, 0), (16, 1), (120, 1)):
        scene = cloth_scene_of(cloth())
        found, frames = frames_of(scene)
        plan = frames.begin(0, posed(found, k / 60), VIEW, 1.0, k / 60, "first frame")
        assert plan.work["cloth_steps_skipped"] == max(0, k - 15)
        assert len([text for text in scene.warnings if "begin at time 0" in text]) == told


def test_particles_that_are_no_numbers_are_told():
    scene = cloth_scene_of(cloth())
    found, frames = frames_of(scene)
    run(frames, found, 0)
    run(frames, found, 1)
    frames.told(1, answer(frames, lost=1.0))
    assert "is lost" in scene.warnings[-1] and "sheet 0" in scene.warnings[-1]
    assert not frames.clock.at_rest.any()


def test_wind_blows_where_its_direction_says():
    for degrees, expected in ((0, (3, 0, 0)), (90, (0, 0, -3)), (180, (-3, 0, 0))):
        blown = ClothSettings(wind_speed=3.0, wind_direction=degrees)
        found, frames = frames_of(cloth_scene_of(cloth()), blown)
        wind = run(frames, found, 0).arrays["frame"][: GLOBALS.itemsize].view(GLOBALS)["wind"][0, :3]
        assert np.allclose(wind, expected, atol=1e-6)
