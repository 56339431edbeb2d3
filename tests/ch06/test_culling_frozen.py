"""Frozen culling: the camera moves, and what is drawn stays what the frozen view saw."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from chapters.ch06.culling.freeze import CUTS, CullingView, without_history
from chapters.ch06.frames.frame import reset_by
from chapters.ch06.settings import Settings
from common import layouts
from common.settings import replaced
from tests.support.culled import commands, words
from tests.support.towns import town, walk

SIZE = (120, 72)
EXACT = Settings(
    color_format="rgba32f", gbuffer_format="full", anisotropy=1.0, ambient=0.3, culling="occlusion"
)
OUTPUTS = ("color_linear", "depth", "instance_id")
COUNTED = ("instances_", "meshlets_", "units_", "triangles_")


@pytest.fixture(scope="module")
def scene():
    return town()


def ways(chapter):
    """Return the geometries that the device has, but for the classic one where it has others."""
    several, tasks = (chapter.device.has(name) for name in ("multi-draw", "mesh-shader"))
    return [*["compute"] * several, *["mesh"] * tasks] or ["classic"]


def images(frame):
    return {name: frame.image(name).copy() for name in OUTPUTS}


def counts(frame):
    return {name: count for name, count in frame.work.items() if name.startswith(COUNTED)}


def assert_same(one, other):
    for name in OUTPUTS:
        assert np.array_equal(one[name], other[name]), name


def drawn(renderer):
    """Return what the last frame's commands draw: (first index, indices, instance) of each, in both phases together."""
    rows = np.concatenate([batch for phase in (0, 1) for batch in commands(renderer, phase)])
    return {tuple(row) for row in rows[:, [2, 0, 4]].tolist()}


@pytest.mark.feature("culling/freeze-and-debug-boxes")
@pytest.mark.parametrize("graph", ["deferred", pytest.param("forward", marks=pytest.mark.long)])
def test_while_frozen_the_same_units_are_drawn_wherever_the_camera_is(chapter, scene, graph):
    """The flags stay, and so do the counters and the lists; what is seen is what was drawn, from another side."""
    views = walk()
    for way in ways(chapter):
        settings = replaced(EXACT, geometry=way, graph=graph)
        with chapter.open(scene, SIZE, settings, outputs=OUTPUTS) as renderer:
            for view in (views[0], views[0], views[0]):
                before = renderer.render(view)
            wanted, listed = counts(before), drawn(renderer)
            flags = words(renderer, "visible", before._slot.index)[: len(scene.instances)]
            renderer.settings.culling.frozen = True
            seen = set()
            for view in (*views[1:], views[-2]):
                frame = renderer.render(view)
                assert counts(frame) == wanted and drawn(renderer) == listed
                assert np.array_equal(words(renderer, "visible", frame._slot.index)[: len(flags)], flags)
                ids = frame.image("instance_id")
                seen |= {*np.unique(ids[ids > 0] - 1).tolist()}
            assert seen <= {*np.flatnonzero(flags).tolist()} and len(seen) > 5
            assert frame.work["recorded"] == 0, "recorded anew when it was frozen, and not later"
            renderer.settings.culling.frozen = False
            assert counts(renderer.render(views[-2])) != wanted, "the camera itself sees something else"


@pytest.mark.variants("vulkan", "gl")
@pytest.mark.parametrize("mode", [pytest.param("frustum", marks=pytest.mark.long), "occlusion"])
def test_the_view_that_is_frozen_is_that_of_the_frame_before(chapter, scene, mode):
    """Also in the second slot, which held the view of an older frame; and the frozen camera sees its own picture."""
    first, second, third = walk()[0], walk()[4], walk()[-1]
    way = ways(chapter)[0]
    with chapter.open(scene, SIZE, replaced(EXACT, culling=mode, geometry=way), outputs=OUTPUTS) as renderer:
        for view in (first, first, second):
            frame = renderer.render(view)
        picture = images(frame)
        renderer.settings.culling.frozen = True
        numbers = [counts(renderer.render(third)) for _ in range(3)]
        assert numbers[0] == numbers[1] == numbers[2]
        assert_same(images(renderer.render(second)), picture)


@pytest.mark.variants("vulkan", "gl")
def test_after_it_the_picture_is_that_of_a_renderer_that_was_never_frozen(chapter, scene):
    views = walk()
    way = ways(chapter)[0]
    settings = replaced(EXACT, geometry=way)
    with chapter.open(scene, SIZE, settings, outputs=OUTPUTS) as renderer:
        renderer.render(views[0])
        renderer.settings.culling.frozen = True
        for view in views[1:4]:
            renderer.render(view)
        renderer.settings.culling.frozen = False
        after = [images(renderer.render(view)) for view in (views[-2], views[-1], views[0])]
    with chapter.open(scene, SIZE, settings, outputs=OUTPUTS) as renderer:
        for view, found in zip((views[-2], views[-1], views[0]), after, strict=True):
            assert_same(images(renderer.render(view)), found)


@pytest.mark.variants("vulkan", "gl")
def test_frozen_from_the_start_the_first_frame_is_kept(chapter, scene):
    way = ways(chapter)[0]
    pictures = {}
    for frozen in (False, True):
        settings = replaced(EXACT, geometry=way, culling_frozen=frozen)
        with chapter.open(scene, SIZE, settings, outputs=OUTPUTS) as renderer:
            pictures[frozen] = images(renderer.render(walk()[0]))
            numbers = [counts(renderer.render(view)) for view in (walk()[0], *walk()[-2:])]
        if not frozen:
            wanted = numbers[0]
    assert_same(*pictures.values())
    assert numbers == [wanted] * 3, "what the first frame saw"


@pytest.mark.variants("vulkan", "gl")
def test_a_jump_of_the_camera_leaves_it_frozen_and_new_tables_freeze_the_next_view(chapter):
    """A resize, an object that is hidden, and a reset: the frame after them is culled by its own view, which stays."""
    way = ways(chapter)[0]
    scene, views = town(), walk()
    with chapter.open(scene, SIZE, replaced(EXACT, geometry=way), outputs=OUTPUTS) as renderer:
        for _ in range(3):
            frame = renderer.render(views[0])
        wanted = counts(frame)
        renderer.settings.culling.frozen = True
        assert counts(renderer.render(replace(views[-2], cut=True))) == wanted

        def reset():
            renderer.reset_history("a test")

        def resize():
            renderer.resize((61, 37))

        def hide():
            with scene.edit() as edit:
                edit.set_visible(0, False)

        for change, view in ((reset, views[0]), (resize, views[2]), (hide, views[4])):
            change()
            shown = images(renderer.render(view))
            numbers = [counts(renderer.render(other)) for other in (views[-2], views[-1], views[3])]
            assert numbers[0] == numbers[1] == numbers[2]
            assert numbers[0]["instances_hidden"] > 0, "the depth of that frame is kept as well"
            uncut = replaced(EXACT, geometry=way, culling="off")
            with chapter.open(scene, renderer.size, uncut, outputs=OUTPUTS) as other:
                assert_same(images(other.render(view)), shown)


@pytest.mark.variants("vulkan")
def test_objects_that_move_are_tested_against_what_is_frozen(chapter):
    """An instance that comes into the frozen view is drawn then; it makes no new tables."""
    scene, view = town(), walk()[0]
    with chapter.open(scene, SIZE, EXACT, outputs=OUTPUTS) as renderer:
        for _ in range(3):
            frame = renderer.render(view)
        outside = frame.work["instances_outside"]
        renderer.settings.culling.frozen = True
        renderer.render(view)
        renderer.render(view)
        flags = words(renderer, "visible", 0)[: len(scene.instances)]
        moved = next(
            number for number in range(10, 60) if not flags[number] and scene.instances.mesh[number] == 0
        )
        place = scene.nodes.matrix[moved].copy()
        place[:3, 3] = view.world_from_view[:3, 3] - 1.5 * view.world_from_view[:3, 2]
        with scene.edit() as edit:
            edit.set_transform(moved, matrix=place)
        frame = renderer.render(view)
        assert frame.work["instances_outside"] <= outside
        assert renderer.techniques["culling"].memory.view.is_frozen
        assert moved + 1 in frame.image("instance_id")


@pytest.mark.variants("vulkan", "gl")
def test_a_window_draws_a_frame_when_a_knob_that_is_live_changes(chapter, scene):
    settings = replaced(EXACT, culling_overlay="pyramid")
    with chapter.open(scene, SIZE, settings) as renderer:
        view, pictures = walk()[0], []
        for name, value in (("level", 4), ("frozen", True), ("level", 5), ("level", 5)):
            before = getattr(renderer.settings.culling, name)
            setattr(renderer.settings.culling, name, value)
            assert renderer.idle(view) == (bool(pictures) and before == value)
            pictures.append(renderer.render(view).image("color").copy())
            assert renderer.idle(view)
    assert np.array_equal(pictures[0], pictures[1]) and np.array_equal(pictures[2], pictures[3])
    assert not np.array_equal(pictures[1], pictures[2]), "another level"


def test_jumps_of_the_camera_are_known_by_the_reasons_of_a_frame():
    view = walk()[0]
    reasons = (reset_by(replace(view, cut=True), 0.0, None), reset_by(view, 0.0, (view, 1.0)))
    assert reasons == CUTS and not reset_by(view, 1.0, (view, 0.0))


def test_a_view_is_written_once_to_each_slot():
    kind = layouts.dtype("FrameConstants")

    def constants(number):
        record = np.zeros(1, kind)
        record["frame_index"] = number
        return record.view(np.uint8)

    def number_of(raw):
        return None if raw is None else int(raw.view(kind)["frame_index"][0])

    view = CullingView()
    steps = [
        (False, 1, False),  # frozen, the view that is written, whether that is one of an earlier frame
        (True, 1, True),
        (True, 1, True),
        (True, None, True),
        (True, None, True),
        (False, 6, False),
        (True, 6, True),
    ]
    for number, (frozen, wanted, held) in enumerate(steps, start=1):
        written = view.advance(number % 2, constants(number), frozen)
        assert (number_of(written), view.is_frozen) == (wanted, held), number
        if written is not None and held:
            assert written.view(kind)["valid_histories"][0] & layouts.HISTORY_FRAME
    view.release()
    assert number_of(view.advance(0, constants(8), True)) == 8 and not view.is_frozen
    record = np.full(1, 0, kind)
    record["valid_histories"] = 0xFF
    kept = without_history(record.view(np.uint8)).view(kind)["valid_histories"][0]
    assert kept == 0xFF & ~layouts.HISTORY_FRAME and record["valid_histories"][0] == 0xFF
