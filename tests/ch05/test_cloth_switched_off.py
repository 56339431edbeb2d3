"""The cloth pass switched off: cloth stays as it hangs, in every slot alike, and goes on from there when it is back."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from chapters.ch05.cloth.steps import CALM_SECONDS, ClothClock
from chapters.ch05.settings import Settings
from common.numerics.transforms import translation
from common.scene import Material
from common.settings import replaced
from tests.support.cloth_runs import AWAY, VIEW, at_rate, picture, run, state
from tests.support.cloth_scenes import cloth, cloth_scene_of
from tools.panel.graph import PassRow, graph_of

pytestmark = pytest.mark.variants("vulkan", "gl")  # nothing of it hangs on what a device may lack

SIZE = (40, 32)
LEVEL = np.array([[1, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0.2], [0, 0, 0, 1.0]])
LIT = Material(base_color=(0.9, 0.2, 0.1, 1), metallic=0.0, double_sided=True)


def hanging(**more):
    """Return a level sheet that is held at two corners, so that it falls at once."""
    return cloth_scene_of(cloth(5, 5, [0, 4]), matrices=[LEVEL], **more)


def settings(**more):
    return replaced(Settings(), graph="forward", cloth_substeps=4, **more)


def near(a, b):
    return np.abs(a.astype(int) - b).max() <= 1


def test_switched_off_cloth_stays_as_it_hangs_and_goes_on_when_it_is_back(chapter):
    with chapter.open(hanging(), SIZE, settings()) as renderer:
        moved = picture(renderer, at_rate(60, 12))
        at, speed = state(renderer), state(renderer, "velocities")
        renderer.switch_pass("cloth", False)
        assert renderer.switches["cloth"] is False
        row = next(row for row in graph_of(renderer).passes if row.name == "cloth")
        assert row == PassRow("cloth", False, "switched off")
        for number in range(13, 17):  # both slots, twice
            frame = renderer.render(VIEW, number / 60)
            assert np.array_equal(frame.image("color"), moved)
            assert frame.work.get("cloth_steps", 0) == 0 and frame.work["dispatches"] == 0
        assert renderer.idle(VIEW, 17 / 60), "or a window would draw the same picture again and again"
        renderer.render(VIEW, 3.0)
        assert np.array_equal(state(renderer), at) and np.array_equal(state(renderer, "velocities"), speed)
        renderer.switch_pass("cloth", True)
        frame = run(renderer, [3.0, 3.0 + 1 / 60])
        assert frame.work["cloth_steps"] == 1 and frame.work["cloth_steps_skipped"] == 0
        went_on = state(renderer)
        assert not any("stood still" in text for text in renderer.scene.warnings)
    with chapter.open(hanging(), SIZE, settings()) as renderer:
        run(renderer, at_rate(60, 13))
        assert np.array_equal(state(renderer), went_on), "step 13 is step 13"


def test_switched_off_from_the_start_it_is_as_it_was_modelled(chapter):
    with chapter.open(hanging(), SIZE, settings(cloth=False)) as renderer:
        modelled = picture(renderer, [0.0])
    with chapter.open(hanging(), SIZE, settings()) as renderer:
        renderer.switch_pass("cloth", False)
        for time in at_rate(60, 4):
            assert np.array_equal(picture(renderer, [time]), modelled)
        renderer.switch_pass("cloth", True)
        run(renderer, at_rate(60, 14, 5))
        began = state(renderer)
    with chapter.open(hanging(), SIZE, settings()) as renderer:
        run(renderer, at_rate(60, 10))
        assert np.array_equal(state(renderer), began)


def test_what_nobody_looked_at_hangs_as_it_did_at_last(chapter):
    """Unseen cloth is simulated, and its vertices wait: they must not be found waiting for ever."""
    with chapter.open(hanging(), SIZE, settings()) as renderer:
        moved = picture(renderer, at_rate(60, 16))
    with chapter.open(hanging(), SIZE, settings()) as renderer:
        run(renderer, at_rate(60, 5))
        run(renderer, at_rate(60, 16, 6), AWAY)
        renderer.switch_pass("cloth", False)
        for number in (17, 18, 19):
            assert near(picture(renderer, [number / 60]), moved)


def test_a_reset_while_it_is_off_lets_it_begin_anew(chapter):
    with chapter.open(hanging(), SIZE, settings()) as renderer:
        modelled = picture(renderer, [0.0])
        run(renderer, at_rate(60, 12, 1))
        renderer.switch_pass("cloth", False)
        renderer.render(VIEW, 13 / 60)
        renderer.reset_history("again")
        for number in range(4):
            assert np.array_equal(picture(renderer, [number / 60]), modelled)
        assert not state(renderer, "velocities").any()


@pytest.mark.long
def test_new_pages_show_it_as_it_hangs_though_it_is_off(chapter):
    scene, other = hanging(material=replace(LIT, unlit=True)), hanging(material=LIT)
    with chapter.open(other, SIZE, settings()) as renderer:
        moved = picture(renderer, at_rate(60, 12))
    with chapter.open(scene, SIZE, settings()) as renderer:
        run(renderer, at_rate(60, 12))
        renderer.switch_pass("cloth", False)
        renderer.render(VIEW, 13 / 60)
        with scene.edit() as edit:
            edit.set_material(0, LIT)
        for number in (14, 15, 16):
            assert near(picture(renderer, [number / 60]), moved)


@pytest.mark.parametrize("graph", [pytest.param("deferred", marks=pytest.mark.long), "compute"])
def test_every_graph_can_do_without_it(chapter, graph):
    if chapter.graph != "forward":
        pytest.skip("it names its graph")
    with chapter.open(hanging(), SIZE, replaced(settings(), graph=graph)) as renderer:
        moved = picture(renderer, at_rate(60, 6))
        renderer.switch_pass("cloth", False)
        assert "cloth_vertices" in renderer.graph.resources
        if chapter.backend == "vulkan":
            assert "compute" not in {step.queue for step in renderer.graph.steps}
        assert np.array_equal(picture(renderer, at_rate(60, 8, 7)), moved)


def test_a_pause_counts_neither_as_steps_nor_as_calm():
    clock, yes = ClothClock(1, 1 / 60), np.array((True,))
    clock.frame(0.0, "first frame", ())
    for k in range(1, 10):
        clock.frame(k / 60, "", ())
    clock.pause(5.0)
    assert clock.done == 300 and not clock.at_rest.any()
    due = clock.frame(5.0 + 1 / 60, "", ())
    assert (due.count, due.skipped) == (1, 0)
    clock.told(clock.mark(), yes, yes)
    assert not clock.at_rest.any(), "it was calm for 10 steps, not for five seconds"
    clock.frame(5.0 + CALM_SECONDS, "", ())
    clock.told(clock.mark(), yes, yes)
    assert clock.at_rest.all()
    clock.pause(1.0)
    assert clock.began and clock.done == 60, "time that runs back begins anew, here as well"


def test_what_is_in_the_way_meanwhile_hits_nothing_on_its_way(chapter):
    """A collider that moved during the pause was put where it is: how long it took nobody knows."""
    scene = hanging(colliders=[({"shape": "sphere", "radius_m": 0.2}, translation((0.4, -0.4, 0.0)))])
    with chapter.open(scene, SIZE, settings()) as renderer:
        run(renderer, at_rate(60, 4))
        renderer.switch_pass("cloth", False)
        with scene.edit() as edit:
            edit.set_transform(1, matrix=translation((0.4, -0.2, 0.0)))
        renderer.render(VIEW, 5 / 60)
        renderer.switch_pass("cloth", True)
        renderer.render(VIEW, 6 / 60)
        assert np.linalg.norm(state(renderer, "velocities"), axis=1).max() < 3.0
