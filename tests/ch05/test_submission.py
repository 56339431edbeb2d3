"""What is submitted to two queues: the same bits however many there are, in an order in which nobody waits in vain."""

from __future__ import annotations

from contextlib import contextmanager

import numpy as np
import pytest

from backends.vulkan import api as vk
from backends.vulkan.device import Queue
from chapters import ch05
from chapters.ch05.frames.frame import SLOTS
from chapters.ch05.frames.queues.vulkan_legacy import LegacySubmit, as_before, stages_before
from tests.support.hazards import Given, Wait, find_hazards
from tests.support.pacing import ends, number, values
from tests.support.queue_frames import N, expected, stream
from tests.support.scenes import facing, quad_scene
from tests.support.traced_frames import Trace, hazards_without

FRAMES = 7


def assert_equal(found, wanted):
    assert len(found) == len(wanted)
    for frame, (one, other) in enumerate(zip(found, wanted, strict=True)):
        assert np.array_equal(one, other), f"frame {frame}"


@pytest.mark.core
@pytest.mark.variants("vulkan")
@pytest.mark.parametrize("own", [True, False], ids=["own queue", "one queue"])
@pytest.mark.parametrize("alias", [True, False], ids=["shared memory", "own memory"])
def test_frames_on_two_queues_are_what_they_should_be(vulkan_device, own, alias):
    with stream(vulkan_device, ch05.__name__, own=own, alias=alias) as frames:
        for _ in range(FRAMES):
            frames.draw()
        assert_equal(frames.finish(), expected(FRAMES))


class Submissions(list):
    """What was submitted and waited for, read as the calls are made: (kind, ...) of each."""

    def __init__(self, frames):
        super().__init__()
        self.names = {number(one.handle): one.name for one in frames.pace.timelines.values()}

    def append(self, call):
        name, arguments = call
        if name == "vkWaitSemaphores":
            super().append(("wait", self._named(ends(name, arguments))))
        elif name == "vkQueueSubmit2":
            infos = [arguments[2][place] for place in range(arguments[1])]
            assert arguments[3] == vk.NULL, "no fence paces a frame"
            sent = [(self._named(values(one, "Wait")), self._named(values(one, "Signal"))) for one in infos]
            super().append(("submit", number(arguments[0]), sent))
        elif name in ("vkWaitForFences", "vkResetFences") or "Idle" in name:
            super().append((name,))

    def _named(self, pairs):
        return [(self.names[semaphore], value) for semaphore, value in pairs]

    @property
    def batches(self):
        """(waits, signals) of each batch, in order."""
        return [batch for kind, *more in self if kind == "submit" for batch in more[1]]

    @property
    def waits(self):
        """What the CPU has waited for."""
        return [more[0] for kind, *more in self if kind == "wait"]


@contextmanager
def watched(device, frames):
    log = Submissions(frames)
    device.fn.trace(log)
    try:
        yield log
    finally:
        device.fn.trace(None)


@pytest.mark.variants("vulkan")
@pytest.mark.feature("timeline/gpu-submit")
def test_values_rise_nobody_waits_for_itself_or_for_what_comes_later(vulkan_device):
    with stream(vulkan_device, ch05.__name__) as frames:
        with watched(vulkan_device, frames._frames) as log:
            for _ in range(FRAMES):
                frames.draw()
        reached = {"graphics": 0, "compute": 0}
        for waits, signals in log.batches:
            assert all(value <= reached[name] for name, value in waits), "it was submitted before"
            ((name, value),) = signals
            assert value == reached[name] + 1
            reached[name] = value
        assert min(reached.values()) >= FRAMES


@pytest.mark.variants("vulkan")
@pytest.mark.feature("timeline/gpu-submit")
def test_frame_n_waits_for_frame_n_less_the_slots_and_the_first_ones_for_nothing(vulkan_device):
    """The CPU alone: of each timeline the value after the last batch of the frame that had the slot before."""
    with stream(vulkan_device, ch05.__name__) as frames:
        last, order = {}, []
        with watched(vulkan_device, frames._frames) as log:
            for frame in range(FRAMES):
                seen = len(log.waits)
                frames.draw()
                order.append(log.waits[seen:])
                last[frame] = {name: value for _, signals in log.batches for name, value in signals}
    assert order[:SLOTS] == [[], []]
    for frame in range(SLOTS, FRAMES):
        ((waits),) = order[frame]
        assert dict(waits) == last[frame - SLOTS]
    assert not [one for one in log if one[0] not in ("wait", "submit")], "nothing else waits"


@pytest.mark.variants("vulkan", "without-all")
@pytest.mark.feature("timeline/gpu-submit")
def test_a_renderer_s_frame_n_waits_for_n_less_one(chapter):
    """With one batch a frame, frame n signals n + 1, and n - (SLOTS - 1) is what it waits for."""
    with chapter.open(quad_scene(), (16, 16)) as made:
        with watched(chapter.device, made._frames) as log:
            for _ in range(6):
                frame = made.render(facing())
        assert log.batches == [([], [("graphics", n + 1)]) for n in range(6)]
        assert log.waits == [[("graphics", n - (SLOTS - 1))] for n in range(SLOTS, 6)]
        assert not [one for one in log if one[0] not in ("wait", "submit")]
        with watched(chapter.device, made._frames) as log:
            frame.image("color")
            _ = frame.image("color"), frame.timings
        assert log.waits == [[("graphics", 6)]], "once is enough"


@pytest.mark.variants("vulkan")
@pytest.mark.feature("async-compute/queue")
def test_the_first_submission_has_no_wait_and_graphics_waits_where_compute_works(vulkan_device):
    with stream(vulkan_device, ch05.__name__) as frames, watched(vulkan_device, frames._frames) as log:
        for _ in range(2):
            frames.draw()
        count = len(frames.executor.batches)
        first = log.batches[:count]
        assert first[0][0] == [], "the first of all"
        for waits, _ in first:
            assert all(value > 0 for _, value in waits)
        assert any(signals[0][0] == "graphics" and waits for waits, signals in first)


class Apart:
    """A device's queue under a second name, as a queue of another one: what is submitted to it goes to the first."""

    def __init__(self, device, monkeypatch):
        self.queue = Queue(vk.ffi.cast("VkQueue", 0x5EC0), device.queue.family, device.queue.flags)
        real = device.fn.vkQueueSubmit2
        self.calls = []

        def submit(queue, count, infos, fence):
            self.calls.append(number(queue))
            return real(device.queue.handle, count, infos, fence)

        monkeypatch.setitem(device.fn.__dict__, "vkQueueSubmit2", submit)
        monkeypatch.setattr(device, "compute_queue", self.queue)


@pytest.mark.variants("vulkan")
@pytest.mark.feature("async-compute/queue")
def test_with_and_without_another_queue_the_same_batches_go_in_the_same_order(vulkan_device, monkeypatch):
    """One queue gets all of a frame in one call; two get what is theirs in a row in one call each."""
    said = []
    for other in (False, True):
        with monkeypatch.context() as patch:
            apart = Apart(vulkan_device, patch)
            with stream(vulkan_device, ch05.__name__, own=other) as frames:
                seen = []
                real = frames._frames._call

                def call(queue, count, frames=frames, seen=seen, real=real):
                    for place in range(count):
                        info = frames._frames._infos[place]
                        names = Submissions(frames._frames)._named
                        seen.append((names(values(info, "Wait")), names(values(info, "Signal"))))
                    real(queue, count)

                patch.setattr(frames._frames, "_call", call)
                apart.calls.clear()
                for _ in range(FRAMES):
                    frames.draw()
                calls = list(apart.calls)
                assert_equal(frames.finish(), expected(FRAMES))
            said.append(seen)
            assert (number(apart.queue.handle) in calls) == other
            if not other:
                assert len(calls) == FRAMES
    assert said[0] == said[1]


@pytest.mark.variants("vulkan")
@pytest.mark.feature("async-compute/queue")
@pytest.mark.feature("async-compute/vertex-hazard-guard")
@pytest.mark.parametrize("apart", [True, False], ids=["two queues", "one queue"])
@pytest.mark.parametrize("alias", [True, False], ids=["shared memory", "own memory"])
def test_what_is_submitted_has_no_hazard_and_each_wait_between_queues_is_needed(vulkan_device, apart, alias):
    """Replayed by a simulated GPU, for which one timeline is one queue, also where the device has but one.

    Without the wait for the frame before, compute would write the state that an earlier frame still reads.
    """
    with stream(vulkan_device, ch05.__name__, alias=alias) as frames:
        for _ in range(2):
            frames.draw()
        trace = Trace(frames, apart)
        before = [Given(f"{name}#{slot}") for name in ("state", "given") for slot in range(SLOTS)]
        events, places = before + trace.events(frames.draw, 6), trace.places
        assert not find_hazards(events, places)
        if not apart:
            return
        between = {event for event in events if isinstance(event, Wait) and event.queue != "host"}
        assert {event.queue for event in between} == {"graphics", "compute"}
        for waited in between:
            found = hazards_without(events, places, lambda event, _, waited=waited: event == waited)
            assert found, waited
        guards = [event for event in between if event.queue == "compute"]
        without = hazards_without(events, places, lambda event, _: event in guards)
        assert any("state" in hazard.resource for hazard in without), "nobody else guards what is read"


def stepped(rests, given=0):
    """Return the results of frames in whose `rests` the state is not stepped: then a slot keeps what it had."""
    i = np.arange(N, dtype=np.uint32)
    states, found = [np.zeros(N, np.uint32), np.zeros(N, np.uint32)], []
    for frame, rest in enumerate(rests):
        now, before = states[frame % 2], states[1 - frame % 2]
        if not rest:
            now = np.uint32(1664525) * before + np.uint32(1013904223) + i
        states[frame % 2] = now
        field = (now * np.uint32(3)).reshape(8, 8)
        found.append((field[::-1].reshape(-1) ^ now) + now)
    return found


@pytest.mark.variants("vulkan")
@pytest.mark.feature("async-compute/queue")
def test_a_batch_of_idle_passes_is_not_submitted_and_nobody_misses_it(vulkan_device):
    rests = [False, False, False, True, True, True, False, True, False, False]
    with stream(vulkan_device, ch05.__name__) as frames:
        passes, counts = frames.made["step"], []
        for rest in rests:
            passes.resting = rest
            frames.draw()
            counts.append(frames._frames.work["batches"])
        assert counts == [max(counts) - rest for rest in rests]
        assert_equal(frames.finish(), stepped(rests))
        frames.made["mix"].resting = True  # it touches images, which others count on
        frames.draw()
        assert frames._frames.work["batches"] == max(counts)


@pytest.mark.variants("vulkan")
@pytest.mark.feature("async-compute/vertex-hazard-guard")
@pytest.mark.parametrize("seed", range(4))
def test_there_is_no_hazard_whenever_compute_rests(vulkan_device, seed):
    rng = np.random.default_rng(seed)
    with stream(vulkan_device, ch05.__name__) as frames:

        def draw():
            frames.made["step"].resting = bool(rng.integers(2))
            frames.draw()

        for _ in range(2):
            frames.draw()
        trace = Trace(frames)
        before = [Given(f"{name}#{slot}") for name in ("state", "given") for slot in range(SLOTS)]
        assert not find_hazards(before + trace.events(draw, 8), trace.places)


@pytest.mark.variants("vulkan")
def test_what_a_pass_says_it_was_recorded_from_has_its_batch_recorded_anew_and_no_other(vulkan_device):
    with stream(vulkan_device, ch05.__name__) as frames:
        for _ in range(3):
            frames.draw()
        times = {name: made.times_recorded for name, made in frames.made.items()}
        assert times == dict.fromkeys(frames.made, SLOTS)
        frames.made["step"].version = 1
        for _ in range(3):
            frames.draw()
        assert {name: made.times_recorded for name, made in frames.made.items()} == times | {
            "step": 2 * SLOTS
        }
        frames.made["sum"].version = 1
        for _ in range(3):
            frames.draw()
        assert frames.made["step"].times_recorded == 2 * SLOTS
        assert frames.made["sum"].times_recorded == frames.made["spread"].times_recorded == 2 * SLOTS
        assert frames.recorded == [True, True, *[False] * 4, True, True, False]
        assert_equal(frames.finish(), expected(9))


@pytest.mark.variants("vulkan")
def test_each_pass_has_its_time_on_either_queue_and_none_while_it_rests(vulkan_device):
    with stream(vulkan_device, ch05.__name__) as frames:
        for rest in (False, True):
            frames.made["step"].resting = rest
            slot = frames.draw()
            frames._frames.wait(slot)
            times = frames._frames.timings(slot)
            assert set(times) == set(frames.made)
            assert (times["step"] == 0) == rest and min(times["mix"], times["sum"]) > 0
            assert list(times) == [step.name for step in in_order(frames)]


def in_order(frames):
    """Return the steps of a graph as they are submitted."""
    return [frames.graph.steps[place] for batch in frames.graph.batches for place in batch.steps]


@pytest.mark.variants("vulkan")
@pytest.mark.feature("timeline/gpu-submit")
def test_submitting_as_before_vulkan_1_3_gives_the_same_bits(vulkan_device, monkeypatch):
    calls = []
    with monkeypatch.context() as patch, stream(vulkan_device, ch05.__name__) as frames:
        real = vulkan_device.fn.vkQueueSubmit
        patch.setitem(vulkan_device.fn.__dict__, "vkQueueSubmit", lambda *a: calls.append(a[1]) or real(*a))
        patch.setitem(vulkan_device.fn.__dict__, "vkQueueSubmit2", LegacySubmit(vulkan_device))
        for _ in range(FRAMES):
            frames.draw()
        assert_equal(frames.finish(), expected(FRAMES))
    assert sum(calls) == len(frames.graph.batches) * FRAMES  # one call for batches in a row of one queue


@pytest.mark.feature("timeline/gpu-submit")
def test_the_old_struct_asks_for_the_same():
    waits = [
        {"semaphore": 1, "value": 7, "stageMask": 0x800},
        {"semaphore": 2, "value": 9, "stageMask": 1 << 33},
    ]
    handle = lambda kind, value: vk.ffi.cast(kind, value)  # noqa: E731
    for one in waits:
        one["semaphore"] = handle("VkSemaphore", one["semaphore"])
    info = vk.new(
        "VkSubmitInfo2",
        pWaitSemaphoreInfos=waits,
        pCommandBufferInfos=[{"commandBuffer": handle("VkCommandBuffer", 5)}],
        pSignalSemaphoreInfos=[{"semaphore": handle("VkSemaphore", 3), "value": 11, "stageMask": 1 << 16}],
    )
    old = as_before(info)
    values_of = vk.ffi.cast("VkTimelineSemaphoreSubmitInfo *", old.pNext)
    assert [number(old.pWaitSemaphores[i]) for i in range(old.waitSemaphoreCount)] == [1, 2]
    assert [old.pWaitDstStageMask[i] for i in range(2)] == [0x800, vk.VK_PIPELINE_STAGE_ALL_COMMANDS_BIT]
    assert [values_of.pWaitSemaphoreValues[i] for i in range(values_of.waitSemaphoreValueCount)] == [7, 9]
    assert (old.commandBufferCount, number(old.pCommandBuffers[0])) == (1, 5)
    assert (number(old.pSignalSemaphores[0]), values_of.pSignalSemaphoreValues[0]) == (3, 11)
    assert stages_before(0) == vk.VK_PIPELINE_STAGE_TOP_OF_PIPE_BIT
