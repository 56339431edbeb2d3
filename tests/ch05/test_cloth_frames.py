"""Cloth in the frame: it follows from the steps made, is the same on every path, and costs nothing at rest."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import chapters
from chapters.ch05.benches.twin import Twin
from chapters.ch05.cloth.scene import cloth_scene
from chapters.ch05.settings import Settings
from common.numerics.transforms import translation
from common.scene import Material
from common.scene.pose import evaluate_pose
from common.settings import replaced
from tests.support.cloth_runs import AWAY, VIEW, at_rate, picture, posed, run, state
from tests.support.cloth_scenes import cloth, cloth_scene_of
from tests.support.scenes import quad_scene

SIZE = (40, 32)
BALL = ({"shape": "sphere", "radius_m": 0.3}, translation((0.1, -0.75, 0.28)))
TIPPED = np.array([[1, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0.2], [0, 0, 0, 1.0]])


def hanging(**fields):
    """Return a sheet that is pinned at two corners, level, so that it falls at once, past a ball."""
    return cloth_scene_of(cloth(5, 5, [0, 4], **fields), matrices=[TIPPED], colliders=[BALL])


def settings(**more):
    return replaced(Settings(), graph="forward", cloth_substeps=4, **more)


def test_pins_are_exact_and_the_rest_hangs_as_the_twin_says(chapter):
    scene = hanging()
    found = cloth_scene(scene)
    with chapter.open(scene, SIZE, settings()) as renderer:
        before = picture(renderer, [0.0])
        frame = run(renderer, at_rate(60, 40, 1))
        work = frame.work
        assert np.abs(frame.image("color").astype(int) - before).max() > 50
        at = state(renderer)
        steps = renderer.techniques["cloth"].cloth.frames.steps
    assert work["cloth_steps"] == 1 and work["cloth_particles"] == 25 and work["cloths_at_rest"] == 0
    rest = found.cloths[0].positions.astype(np.float32)
    assert np.array_equal(at[[0, 4]], rest[[0, 4]]) and np.isfinite(at).all()
    assert at[20:, 1].max() < rest[20:, 1].min() - 0.3, "the lower edge has fallen"
    twin = Twin(
        found.cloths[0],
        steps,
        colliders=found.colliders(posed(found, 0.0)),
        dtype=np.float32,
    )
    twin.advance(40)
    assert np.abs(at - twin.state.positions).max() < 2e-3


def test_frames_of_other_lengths_come_to_the_same_bits(chapter):
    found = []
    for times in (at_rate(60, 24), at_rate(30, 12), at_rate(120, 48), [0.0, 0.11, 0.25, 0.4]):
        with chapter.open(hanging(), SIZE, settings(wind_speed=2.0)) as renderer:
            found.append((picture(renderer, times), state(renderer), state(renderer, "velocities")))
    for one in found[1:]:
        for a, b in zip(one, found[0], strict=True):
            assert np.array_equal(a, b)


def test_at_one_moment_there_is_nothing_more_to_draw(chapter):
    """A picture of one time is done after one frame, however much the cloth moves: `idle` says so, and is right."""
    with chapter.open(cloth_scene_of(cloth()), SIZE, settings()) as renderer:
        run(renderer, at_rate(60, 12))
        now = 12 / 60
        first = picture(renderer, [now])
        assert renderer.idle(VIEW, now) and not renderer.idle(VIEW, now + 1 / 60)
        assert not renderer.idle(VIEW, 0.0), "time that runs back begins anew"
        assert np.array_equal(picture(renderer, [now]), first) and np.array_equal(
            picture(renderer, [now]), first
        )


def test_at_rest_nothing_is_dispatched_and_the_picture_stays(chapter):
    scene = cloth_scene_of(cloth(damping_per_s=30))
    with chapter.open(scene, SIZE, settings()) as renderer:
        number = 0
        while not (frame := renderer.render(VIEW, number / 60)).work["cloths_at_rest"]:
            number += 1
            assert not renderer.idle(VIEW, number / 60)
            assert number < 200
        run(renderer, at_rate(60, number + 3, number + 1))
        still = picture(renderer, [(number + 4) / 60])
        at = state(renderer)
        assert renderer.idle(VIEW, 1e3)
        for later in at_rate(60, number + 104, number + 5):
            frame = renderer.render(VIEW, later)
            assert frame.work["cloth_steps"] == frame.work["cloth_steps_skipped"] == 0
            assert frame.work["cloths_at_rest"] == 1 and frame.work.get("dispatches", 0) == 0
            assert np.abs(frame.image("color").astype(int) - still).max() <= 1
        assert np.array_equal(state(renderer), at)
        if chapter.backend == "vulkan":
            assert renderer._frames.work["batches"] == 1, "nothing goes to the compute queue"
        renderer.settings.cloth.wind_speed, renderer.settings.cloth.wind_direction = 8.0, 90.0
        assert not renderer.idle(VIEW, 1e3), (
            "a window that draws no frames while nothing changes draws one now"
        )
        frame = run(renderer, at_rate(60, number + 125, number + 105))
        assert frame.work["cloths_at_rest"] == 0 and frame.work["cloth_steps"] == 1
        assert np.abs(frame.image("color").astype(int) - still).max() > 20


def test_pins_follow_their_node_and_a_collider_wakes_what_it_meets(chapter):
    scene = cloth_scene_of(cloth(damping_per_s=30), colliders=[(BALL[0], translation((9, 9, 9)))])
    with chapter.open(scene, SIZE, settings()) as renderer:
        number = 0
        while not renderer.render(VIEW, number / 60).work["cloths_at_rest"]:
            number += 1
        rest = state(renderer)
        with scene.edit() as edit:
            edit.set_transform(1, matrix=translation((0, -0.6, 0.1)))
        assert run(renderer, at_rate(60, number + 20, number + 1)).work["cloths_at_rest"] == 0
        pushed = state(renderer)
        assert np.array_equal(pushed[:5], rest[:5]) and np.abs(pushed - rest).max() > 0.1
        center = np.array((0, -0.6, 0.1))
        assert np.linalg.norm(pushed - center, axis=1).min() > 0.3, "none is in the ball"
        with scene.edit() as edit:
            edit.set_transform(0, matrix=translation((0.25, 0, 0)))
        run(renderer, at_rate(60, number + 40, number + 21))
        assert np.array_equal(state(renderer)[:5], rest[:5] + np.array((0.25, 0, 0), np.float32))


def test_what_was_unseen_is_where_it_would_be(chapter):
    pictures, states = [], []
    for view in (VIEW, AWAY):
        with chapter.open(hanging(), SIZE, settings()) as renderer:
            run(renderer, at_rate(60, 4))
            run(renderer, at_rate(60, 30, 5), view)
            pictures.append(picture(renderer, at_rate(60, 33, 31)))
            states.append(state(renderer))
    assert np.array_equal(*states) and np.array_equal(*pictures)


@pytest.mark.core
@pytest.mark.parametrize(
    "by", ["node", *(pytest.param(by, marks=pytest.mark.long) for by in ("collider", "wind"))]
)
def test_what_comes_into_view_at_once_is_drawn_where_it_is(chapter, by, monkeypatch):
    """Where an unseen cloth is was told two frames ago, and what acts on it may have sent it anywhere since."""
    edge = np.array([[0, 0, 1, -2.2], [0, 1, 0, 0], [-1, 0, 0, 0], [0, 0, 0, 1.0]])
    begins = {"node": translation((30, 0, 0)), "collider": translation((-3, 0, 0)), "wind": edge}[by]
    ball = {"shape": "sphere", "radius_m": 2.5}, translation((-30, -0.5, 0))
    found = []
    for look in (None, lambda self, *_: np.ones(1, bool)):
        if look:
            monkeypatch.setattr("chapters.ch05.cloth.frames.ClothFrames._seen", look)
        scene = cloth_scene_of(
            cloth(pins=[0, 4] if by == "node" else []), matrices=[begins], colliders=[ball]
        )
        with chapter.open(scene, SIZE, settings()) as renderer:
            run(renderer, at_rate(60, 8))
            if by == "wind":
                renderer.settings.cloth.wind_speed = 60.0
            else:
                with scene.edit() as edit:
                    if by == "node":
                        edit.set_transform(0, matrix=np.eye(4))
                    else:
                        edit.set_transform(1, matrix=translation((-3.3, -0.5, 0)))
            found.append([picture(renderer, [time]) for time in at_rate(60, 14, 9)])
    assert np.array_equal(*found)
    assert len({one.tobytes() for one in found[0]}) > 1


@pytest.mark.core
def test_the_same_calls_after_a_reset_give_the_same_pixels(chapter):
    scene = hanging()
    times = at_rate(60, 12)
    with chapter.open(scene, SIZE, settings()) as renderer:
        first = [picture(renderer, [time]) for time in times]
        renderer.reset_history("again")
        second = [picture(renderer, [time]) for time in times]
        backwards = [picture(renderer, [time]) for time in times]  # time 0 after 0.2
    for a, b, c in zip(first, second, backwards, strict=True):
        assert np.array_equal(a, b) and np.array_equal(a, c)
    assert not np.array_equal(first[0], first[-1])


def test_neither_another_size_nor_a_cut_hides_that_the_cloth_begins_anew(chapter):
    """A frame has one reason for having no history: what a resize or a cut says must not stand before a reset."""
    with chapter.open(hanging(), SIZE, settings()) as renderer:
        expected = picture(renderer, at_rate(60, 4))
        run(renderer, at_rate(60, 20, 5))
        renderer.reset_history("again")
        renderer.resize((24, 24))
        renderer.resize(SIZE)
        assert np.array_equal(picture(renderer, at_rate(60, 4)), expected)
        run(renderer, at_rate(60, 20, 5))
        renderer.render(replace(VIEW, cut=True), 0.0)
        assert np.array_equal(picture(renderer, at_rate(60, 4, 1)), expected)


@pytest.mark.parametrize("failing", ["cloth", "tonemap"])
def test_a_frame_that_fails_costs_no_step(chapter, failing, monkeypatch):
    """Its steps are due in the next one, and no slot is taken to show what was never written."""
    still = at_rate(60, 30, 25)
    with chapter.open(hanging(damping_per_s=40), SIZE, settings()) as renderer:
        run(renderer, at_rate(60, 20))
        expected = [picture(renderer, [time]) for time in at_rate(60, 24, 21) + still]
        at = state(renderer)
    with chapter.open(hanging(damping_per_s=40), SIZE, settings()) as renderer:
        run(renderer, at_rate(60, 5))
        made = next(one for one in renderer.passes if one.name == failing)
        with monkeypatch.context() as patch:
            patch.setattr(made, "record", lambda *_: 1 / 0)
            for time in at_rate(60, 8, 6):
                renderer._frames.forget()
                with pytest.raises(ZeroDivisionError):
                    renderer.render(VIEW, time)
        renderer._frames.forget()
        run(renderer, at_rate(60, 20, 9))
        assert np.array_equal([picture(renderer, [time]) for time in at_rate(60, 24, 21) + still], expected)
        assert np.array_equal(state(renderer), at)


def test_another_size_or_a_cut_goes_on_with_the_cloth(chapter):
    with (
        chapter.open(hanging(), SIZE, settings()) as plain,
        chapter.open(hanging(), (24, 24), settings()) as other,
    ):
        expected = picture(plain, at_rate(60, 20))
        run(other, at_rate(60, 9))
        other.resize(SIZE)
        other.render(replace(VIEW, cut=True), 10 / 60)
        assert np.array_equal(picture(other, at_rate(60, 20, 11)), expected)


def test_an_edit_of_its_material_leaves_the_cloth_where_it_is(chapter):
    """Lit after unlit: the pages of geometry are others then, with normals in them."""
    lit = Material(base_color=(0.9, 0.2, 0.1, 1), metallic=0.0, double_sided=True)
    scene = hanging()
    scene.materials[0] = replace(lit, unlit=True)
    other = hanging()
    other.materials[0] = lit
    with chapter.open(scene, SIZE, settings()) as renderer, chapter.open(other, SIZE, settings()) as plain:
        run(renderer, at_rate(60, 10))
        with scene.edit() as edit:
            edit.set_material(0, lit)
        assert np.array_equal(picture(renderer, at_rate(60, 14, 11)), picture(plain, at_rate(60, 14)))


@pytest.mark.long
def test_new_pages_show_a_cloth_at_rest_as_it_hangs(chapter):
    """It is not simulated, but what the file says of its vertices is not how it hangs."""
    lit = Material(base_color=(0.9, 0.2, 0.1, 1), metallic=0.0, double_sided=True)
    pictures = []
    for first in (replace(lit, unlit=True), lit):
        scene = cloth_scene_of(cloth(damping_per_s=20, stretch_n_per_m=10), material=first)
        with chapter.open(scene, SIZE, settings()) as renderer:
            number = 0
            while not renderer.render(VIEW, number / 60).work["cloths_at_rest"]:
                number += 1
            with scene.edit() as edit:
                edit.set_material(0, lit)
            last = renderer.render(VIEW, (number + 1) / 60)
            pictures.append(last.image("color").copy())
            assert last.work["cloths_at_rest"] == 1
            modelled = picture(renderer, [0.0])
    assert np.array_equal(*pictures)
    assert np.abs(pictures[0].astype(int) - modelled).max() > 20, "the modelled sheet is shorter"


def test_two_renderers_share_a_scene(chapter):
    scene = hanging()
    with chapter.open(scene, SIZE, settings()) as one, chapter.open(scene, SIZE, settings()) as two:
        first = picture(one, at_rate(60, 15))
        assert np.array_equal(picture(two, at_rate(60, 15)), first)
        with scene.edit() as edit:
            edit.set_visible(0, False)
        hidden = picture(one, [16 / 60])
        assert not np.array_equal(hidden, first) and np.array_equal(hidden, picture(two, [16 / 60]))
    assert evaluate_pose(scene, 0.0).vertices == {}, "nothing of it is in the user's scene"


def test_a_second_in_one_frame_is_clamped_and_told(chapter):
    scene = hanging()
    with chapter.open(scene, SIZE, settings()) as renderer:
        frame = run(renderer, [0.0, 1 / 60, 1 + 1 / 60])
        assert (frame.work["cloth_steps"], frame.work["cloth_steps_skipped"]) == (15, 45)
        assert np.isfinite(state(renderer)).all()
    assert any("stood still for 45 steps" in text for text in scene.warnings)


@pytest.mark.parametrize("graph", [pytest.param("deferred", marks=pytest.mark.long), "compute"])
def test_every_graph_draws_the_cloth_that_moved(chapter, graph):
    if chapter.graph != "forward":
        pytest.skip("it names its graph")
    chosen = replaced(settings(depth_prepass=True, poison="depth 1"), graph=graph)
    with chapter.open(hanging(), SIZE, chosen, outputs={"color", "instance_id"}) as renderer:
        run(renderer, at_rate(60, 19))
        frame = renderer.render(VIEW, 20 / 60)
        seen = frame.image("instance_id").copy()
    with chapter.open(hanging(), SIZE, settings(), outputs={"color", "instance_id"}) as renderer:
        plain = run(renderer, at_rate(60, 20)).image("instance_id")
    assert np.array_equal(seen, plain) and len(np.unique(plain)) == 2


def test_without_cloth_a_frame_is_that_of_chapter_4(chapter):
    """Also with cloth that is not to move: the same graph, the same bits, and nothing for the compute queue."""
    scene = quad_scene(Material(base_color=(0.9, 0.5, 0.1, 1.0)))
    dressed = hanging()
    with chapter.open(scene, SIZE, settings()) as renderer:
        now = picture(renderer, at_rate(60, 2))
        assert {"cloth"} == {*renderer.graph.left_out} & {"cloth"}
        assert "cloth_steps" not in renderer.render(VIEW, 1.0).work
        if chapter.backend == "vulkan":
            assert renderer._frames.work["batches"] == 1
    with chapter.open(dressed, SIZE, settings(cloth=False)) as renderer:
        stiff = picture(renderer, at_rate(60, 2))
        steps = [step.name for step in renderer.graph.steps]
    module = chapters.renderer_module(4, chapter.backend)
    for each, expected in ((scene, now), (dressed, stiff)):
        before = module.Renderer(
            each, SIZE, replaced(chapters.settings_class(4)(), graph="forward"), device=chapter.device
        )
        with before:
            assert np.array_equal(picture(before, at_rate(60, 2)), expected)
            assert steps == [step.name for step in before.graph.steps]


def test_what_is_odd_is_drawn_all_the_same(chapter):
    """Vertices twice and of no triangle, one triangle, no pins, no springs that hold, a mass next to nothing."""
    twice = hanging()
    twice.positions[7] = twice.positions[6]  # coincident: a triangle between them has no area
    lone = cloth_scene_of(cloth(2, 2, [0], kg_per_m2=1e-6), size=(2, 2))
    lone.meshes["index_count"] = 3
    free = cloth_scene_of(cloth(pins=[], stretch_n_per_m=1, shear_n_per_m=1e6, bend_n_per_m=1e6))
    for scene in (twice, lone, free):
        with chapter.open(scene, SIZE, settings(wind_speed=5.0)) as renderer:
            run(renderer, at_rate(60, 10))
            assert np.isfinite(state(renderer)).all()
    assert "no pins" in free.warnings[0]


@pytest.mark.variants("vulkan")
def test_a_queue_of_its_own_changes_no_bit(chapter):
    found = []
    for own in (True, False):
        with chapter.open(hanging(), SIZE, settings(async_compute=own)) as renderer:
            found.append((picture(renderer, at_rate(60, 20)), state(renderer)))
            assert [batch.queue for batch in renderer.graph.batches] == ["compute", "graphics"]
    assert all(np.array_equal(a, b) for a, b in zip(*found, strict=True))


@pytest.mark.long  # two renderers and both their kernels; test_cloth_kernels.py compares the kernels alone each time
@pytest.mark.variants("vulkan")
def test_opengl_draws_the_same_bits(chapter):
    gl = replace(chapter, backend="gl", device=None)
    scene = hanging()
    with chapter.open(scene, SIZE, settings(wind_speed=3.0)) as renderer:
        here = picture(renderer, at_rate(60, 20)), state(renderer)
    with gl.open(scene, SIZE, settings(wind_speed=3.0)) as renderer:
        there = picture(renderer, at_rate(60, 20)), state(renderer)
    if not chapter.device.capabilities.is_software:  # two compilers: see `shaken` in test_cloth_kernels.py
        assert np.allclose(here[1], there[1], rtol=0, atol=1e-4)
        return
    assert np.array_equal(here[1], there[1])
    assert np.abs(here[0].astype(int) - there[0]).max() <= 1


def test_a_renderer_keeps_the_cloth_that_it_was_opened_with(chapter):
    """What is asked anew while it runs, when a material changes, is not whether there is cloth."""
    scene = hanging()
    with chapter.open(scene, SIZE, settings()) as renderer:
        expected = picture(renderer, at_rate(60, 12))
    with chapter.open(scene, SIZE, settings()) as renderer:
        run(renderer, at_rate(60, 5))
        renderer.settings.cloth.enabled = False
        extras = scene.nodes.extras.pop(0)
        with scene.edit() as edit:
            edit.set_material(0, scene.materials[0])
        assert np.array_equal(picture(renderer, at_rate(60, 12, 6)), expected)
    scene.nodes.extras[0] = extras
