"""Frames in flight: which slot is waited for and when, what a frame that is gone says, and what resizing takes away."""

from __future__ import annotations

import gc
import math
import weakref
from dataclasses import replace

import numpy as np
import pytest

from backends.vulkan import api as vk
from chapters.ch01.frames.vulkan import SLOTS, Frames
from common.errors import StaleFrameError
from common.scene import Light, Material
from tests.support.chapter import record_anew, targets_of
from tests.support.scenes import facing, quad_scene, translated

on_vulkan = pytest.mark.variants("vulkan", "without-all")
"""For tests that look at the objects behind the contract."""

SIZE = (24, 16)
SUN = Light("directional", node=0, intensity=math.pi)


def lit_quad(**more):
    return quad_scene(Material(metallic=0.0, roughness=1.0), lights=(SUN,), **more)


@pytest.fixture
def frames(chapter):
    made = Frames(chapter.device)
    yield made
    made.close()


@pytest.mark.until(4, "timelines pace the frames, without fences")
@on_vulkan
@pytest.mark.feature("device/frames-in-flight")
def test_a_slot_is_waited_for_before_its_commands_are_thrown_away(chapter, frames):
    """The order of calls over five frames: slots in turns, of each the fence, then the pool, then the submission."""
    pools = {int(vk.ffi.cast("uintptr_t", slot.pool)): slot.index for slot in frames.slots}
    fences = {int(vk.ffi.cast("uintptr_t", slot.fence)): slot.index for slot in frames.slots}
    log: list = []
    chapter.device.fn.trace(log)
    for _ in range(5):
        frames.submit(frames.begin())
    chapter.device.fn.trace(None)

    def number(handle, known):
        return known[int(vk.ffi.cast("uintptr_t", handle))]

    order = []
    for name, arguments in log:
        if name == "vkWaitForFences":
            order.append(("wait", number(arguments[2][0], fences)))
        elif name == "vkResetCommandPool":
            order.append(("reset", number(arguments[1], pools)))
        elif name == "vkQueueSubmit2":
            order.append(("submit", number(arguments[3], fences)))
    slots = [frame % SLOTS for frame in range(5)]
    assert order == [(what, slot) for slot in slots for what in ("wait", "reset", "submit")]
    assert frames.number == 5


@pytest.mark.until(4, "timelines pace the frames, without fences")
@on_vulkan
def test_nothing_but_the_slot_that_is_needed_is_waited_for(chapter):
    """A frame waits once, for the fence of the frame two before; the newest one goes on beside it."""
    with chapter.open(lit_quad(), SIZE) as made:
        for _ in range(2):
            made.render(facing())
        log: list = []
        chapter.device.fn.trace(log)
        made.render(facing())
        chapter.device.fn.trace(None)
        waits = [arguments for name, arguments in log if name.startswith("vkWait")]
        assert len(waits) == 1
        assert waits[0][2][0] == made._frames.slots[0].fence
        assert not [name for name, _ in log if name in ("vkDeviceWaitIdle", "vkQueueWaitIdle")]


@pytest.mark.feature("device/uniform-buffers")
def test_both_slots_show_what_was_asked_of_them(chapter):
    """Four views in a row, each read two frames late: nobody sees the other slot's constants."""
    places = [-0.5, 0.0, 0.5, 1.0]

    def view(x):
        return replace(facing(ymag=2.0), world_from_view=translated(x, z=2.0))

    with chapter.open(lit_quad(), SIZE, outputs={"depth"}) as made:
        alone = []
        for x in places:
            alone.append(made.render(view(x)).image("depth"))
        queued, images = [], []
        for x in places:
            queued.append(made.render(view(x)))
            if len(queued) > 1:
                images.append(queued[-2].image("depth"))
        images.append(queued[-1].image("depth"))
    assert all(np.array_equal(a, b) for a, b in zip(alone, images, strict=True))
    assert not np.array_equal(alone[0], alone[1])


def test_a_frame_that_is_gone_says_which_one_took_its_place(chapter):
    with chapter.open(lit_quad(), SIZE) as made:
        frames = [made.render(facing()) for _ in range(SLOTS + 1)]
        with pytest.raises(
            StaleFrameError, match=r"^Frame 0 is gone: its slot was used again by frame 2\. Read "
        ):
            frames[0].image("color")
        assert frames[1].image("color").shape == (16, 24, 3)


def test_work_and_timings_stay_when_the_picture_is_gone(chapter):
    """The contract: an image until its slot is used again, timings and work for good, read before or not."""
    with chapter.open(lit_quad(), SIZE) as made:
        frames = [made.render(facing()) for _ in range(5)]
        assert [list(frame.timings) for frame in frames] == [["forward", "tonemap"]] * 5
        assert frames[0].work["draws"] == 2
        kept = frames[4]
        made.resize((10, 10))
        assert list(kept.timings) == ["forward", "tonemap"]
        last = made.render(facing())
    assert list(last.timings) == ["forward", "tonemap"]
    assert frames[0].timings == frames[0].timings


def test_frames_that_nobody_keeps_are_not_kept(chapter):
    with chapter.open(lit_quad(), SIZE) as made:
        frame = weakref.ref(made.render(facing()))
        gc.collect()
        assert frame() is None


def test_a_frame_from_before_a_resize_is_gone(chapter):
    """Its copy in the CPU's memory went with the old size; reading would show memory that nobody wrote."""
    with chapter.open(lit_quad(), SIZE) as made:
        frame = made.render(facing())
        made.resize((30, 10))
        with pytest.raises(
            StaleFrameError, match="Frame 0 is gone: the size of the picture has changed since"
        ):
            frame.image("color")
        frame = made.render(facing())
        made.resize((30, 10))
        assert frame.image("color").shape == (10, 30, 3), "the size that it has is no other"
        assert made.render(facing()).index == 1


def test_a_frame_of_a_closed_renderer_is_gone(chapter):
    with chapter.open(lit_quad(), SIZE) as made:
        frame = made.render(facing())
    with pytest.raises(StaleFrameError, match="Frame 0 is gone: its renderer was closed"):
        frame.image("color")


def test_a_closed_renderer_renders_no_more(chapter):
    with chapter.open(lit_quad(), SIZE) as made:
        pass
    with pytest.raises(StaleFrameError, match="renderer was closed"):
        made.render(facing())


@pytest.mark.parametrize("failing", ["forward", "tonemap"])
def test_a_frame_that_fails_leaves_the_next_one_whole(chapter, monkeypatch, failing):
    """An exception amid recording, as Ctrl-C would be: its commands are thrown away, other frames are untouched."""
    with chapter.open(lit_quad(), SIZE) as made:
        expected = made.render(facing()).image("color")
        kept = made.render(facing())

        def interrupted(commands):
            raise KeyboardInterrupt

        with monkeypatch.context() as patch:
            (one,) = (found for found in made.passes if found.name == failing)
            patch.setattr(one, "record", interrupted)
            record_anew(made)
            with pytest.raises(KeyboardInterrupt):
                made.render(facing(distance=1.0))
        assert np.array_equal(kept.image("color"), expected)
        for _ in range(3):
            frame = made.render(facing())
            assert np.array_equal(frame.image("color"), expected)
            assert list(frame.timings) == ["forward", "tonemap"]


def test_a_renderer_that_closes_because_a_frame_failed_hides_no_reason(chapter):
    def broken(commands):
        raise ValueError("a slip of the pen")

    def run():
        with chapter.open(lit_quad(), SIZE) as made:
            made.passes[-1].record = broken
            made.render(facing())

    with pytest.raises(ValueError, match="a slip of the pen") as caught:
        run()
    assert caught.value.__context__ is None


@pytest.mark.until(3, "of a frame of which nobody reads anything no pass is left")
def test_a_renderer_that_nobody_reads_draws_all_the_same(chapter):
    with chapter.open(lit_quad(), SIZE, outputs=()) as made:
        frames = [made.render(facing()) for _ in range(3)]
        assert list(frames[-1].timings) == ["forward"]
        assert frames[-1].work["draws"] == 1
        with pytest.raises(StaleFrameError, match="not among this renderer's outputs"):
            frames[-1].image("color")


@pytest.mark.feature("device/viewport-resize")
@pytest.mark.parametrize("sizes", [[(1, 1)], [(13, 7)], [(257, 3), (3, 257)], [(300, 200), (1, 1), (64, 48)]])
def test_every_size_gives_the_picture_of_a_new_renderer(chapter, sizes):
    outputs = {"color", "depth", "instance_id"}
    with chapter.open(lit_quad(), SIZE, outputs=outputs) as made:
        for size in sizes:
            made.resize(size)
            frame = made.render(facing(ymag=1.5))
            resized = {name: frame.image(name) for name in outputs}
    with chapter.open(lit_quad(), sizes[-1], outputs=outputs) as made:
        frame = made.render(facing(ymag=1.5))
        for name in outputs:
            assert np.array_equal(frame.image(name), resized[name]), name


def test_resizing_leaves_nothing_behind(chapter):
    with chapter.open(lit_quad(), SIZE) as made:
        for _ in range(3):
            first = made.render(facing())
        alive, sets = len(chapter.device.alive), first.work["descriptor_sets"]
        for size in [(40, 30), (7, 5), (100, 1), SIZE]:
            made.resize(size)
            for _ in range(SLOTS + 1):
                frame = made.render(facing())
        assert len(chapter.device.alive) == alive
        assert frame.work["descriptor_sets"] == sets
        # Even a window that is dragged for long without a frame keeps one set of targets.
        for width in range(20, 40):
            made.resize((width, 20))
        made.render(facing())
        assert len(chapter.device.alive) <= alive + 2 * len(targets_of(made))


@pytest.mark.feature("device/viewport-resize")
def test_a_square_stays_square_when_the_window_does_not(chapter):
    with chapter.open(lit_quad(), (64, 64), outputs={"instance_id"}) as made:
        for size in [(64, 64), (96, 48), (48, 96)]:
            made.resize(size)
            ids = made.render(facing(ymag=2.0)).image("instance_id")
            rows, columns = np.flatnonzero(ids.any(axis=1)), np.flatnonzero(ids.any(axis=0))
            assert abs(len(rows) - len(columns)) <= 1
            assert len(rows) == size[1] // 2
