"""The study timeline-or-fences: the same bits in each way, by fewer objects, and what each way asks of the driver."""

from __future__ import annotations

from collections import Counter

import numpy as np
import pytest

import chapters
from backends.vulkan import api as vk
from chapters import studies
from chapters.ch05.benches.pacing import COUNTED, measure_pacing
from chapters.ch05.frames.frame import SLOTS
from chapters.ch05.studies.timeline_or_fences import CELLS, WAYS, Settings
from tools.bench.points import Subject

WHICH = "5/timeline-or-fences"
SIZE = (CELLS, CELLS)
TIMES = (0.0, 0.1, 0.45, 1.0, 3.99, 0.2)


def expected(time):
    """Return the picture of a moment, (CELLS, CELLS) uint8: each cell is a pixel."""
    place = np.arange(CELLS) * 2 - (CELLS - 1)
    far = place[None] ** 2 + place[:, None] ** 2
    return ((far // 16 - int(np.floor(time * 64))) & 255).astype(np.uint8)


def opened(device, way, without=()):
    """Open the study in one of its ways."""
    more = {"settings": Settings(way=way), "device": device, "without": without}
    return chapters.open(WHICH, "vulkan", scene=studies.load(WHICH, None), size=SIZE, **more)


def drawn(device, way, without=()):
    """Return the pictures of some moments, each read when the next frame is under way, and the work of each frame."""
    pictures, work, before = [], [], None
    with opened(device, way, without) as made:
        for time in TIMES:
            frame = made.render(chapters.view_of(made), time)
            work.append(frame.work)
            if before is not None:
                pictures.append(before.image("color"))
            before = frame
        pictures.append(before.image("color"))
    return pictures, work


@pytest.mark.feature("timeline/support-fallback")
@pytest.mark.feature("timeline/gpu-submit")
@pytest.mark.parametrize("without", [(), ("async-compute",)], ids=["as it is", "one queue"])
def test_each_way_draws_what_the_kernel_should_have_written(vulkan_device, without):
    for way in WAYS:
        pictures, _ = drawn(vulkan_device, way, without)
        for time, picture in zip(TIMES, pictures, strict=True):
            for channel in range(3):
                assert np.array_equal(picture[..., channel], expected(time)), (way, time)


@pytest.mark.feature("timeline/support-fallback")
def test_timelines_take_two_objects_and_fences_three_for_each_slot(vulkan_device):
    counted = {way: drawn(vulkan_device, way)[1] for way in WAYS}
    for way, frames in counted.items():
        assert {work["objects"] for work in frames} == {3 * SLOTS if way == "fences" else 2}
        # The first frame has nothing before it, and the first ones no slot that somebody could still use.
        assert [work["queue_waits"] for work in frames] == [1] + [2] * (len(TIMES) - 1)
        first = 1 if way == "fences" else 0
        assert [work["cpu_waits"] for work in frames] == [first] * SLOTS + [1] * (len(TIMES) - SLOTS)


@pytest.mark.feature("timeline/support-fallback")
@pytest.mark.parametrize("way", WAYS)
def test_a_way_makes_and_calls_nothing_of_the_others(vulkan_device, way):
    log = []
    vulkan_device.fn.trace(log)
    try:
        with opened(vulkan_device, way) as made:
            log.clear()
            for time in TIMES:
                made.render(chapters.view_of(made), time)
            calls = Counter(name for name, _ in log)
    finally:
        vulkan_device.fn.trace(None)
    fences = {name: calls[name] for name in ("vkWaitForFences", "vkResetFences")}
    count = len(TIMES)
    assert fences == dict.fromkeys(fences, count if way == "fences" else 0)
    assert calls["vkWaitSemaphores"] == (0 if way == "fences" else count - SLOTS)
    assert calls["vkQueueSubmit"] == (2 * count if way == "timelines-1.2" else 0)
    assert calls["vkQueueSubmit2"] == (0 if way == "timelines-1.2" else 2 * count)


@pytest.mark.feature("timeline/support-fallback")
def test_the_fences_way_has_no_timeline_and_the_others_no_fence(vulkan_device):
    for way in WAYS:
        before = set(vulkan_device.alive)
        log = []
        vulkan_device.fn.trace(log)
        try:
            with opened(vulkan_device, way):
                paced = {ctype for ctype, _ in set(vulkan_device.alive) - before}
                timelines = [
                    arguments[1].pNext != vk.NULL for name, arguments in log if name == "vkCreateSemaphore"
                ]
        finally:
            vulkan_device.fn.trace(None)
        assert "VkSemaphore" in paced and ("VkFence" in paced) == (way == "fences")
        kept = timelines[-2 * SLOTS :] if way == "fences" else timelines[-2:]
        assert set(kept) == {way != "fences"}


# --- by the calls alone: in which order things must happen ---


class Asked(list):
    """A trace of what paces frames, read at the moment of each call: the study uses its structs again."""

    def append(self, call):
        name, arguments = call
        if name == "vkQueueSubmit2":
            info = arguments[2][0]
            waits = [info.pWaitSemaphoreInfos[i] for i in range(info.waitSemaphoreInfoCount)]
            signals = [info.pSignalSemaphoreInfos[i] for i in range(info.signalSemaphoreInfoCount)]
            pairs = [[(one.semaphore, one.value) for one in some] for some in (waits, signals)]
            commands = info.pCommandBufferInfos[0].commandBuffer
            super().append(("submit", arguments[0], commands, *pairs, arguments[3]))
        elif name == "vkQueueSubmit":
            info = arguments[2][0]
            beside = vk.ffi.cast("VkTimelineSemaphoreSubmitInfo *", info.pNext)
            waits = [
                (info.pWaitSemaphores[i], beside.pWaitSemaphoreValues[i])
                for i in range(info.waitSemaphoreCount)
            ]
            signals = [
                (info.pSignalSemaphores[i], beside.pSignalSemaphoreValues[i])
                for i in range(info.signalSemaphoreCount)
            ]
            super().append(("submit", arguments[0], info.pCommandBuffers[0], waits, signals, arguments[3]))
        elif name == "vkWaitSemaphores":
            super().append(("wait", arguments[1].pSemaphores[0], arguments[1].pValues[0]))
        elif name == "vkWaitForFences":
            super().append(("fence", arguments[2][0]))
        elif name == "vkResetCommandPool":
            super().append(("record",))


def order(asked):
    """Return what must come before what: edges of the CPU's own order, and those of each thing that is waited for.

    Nodes are ("cpu", place in the trace) and ("gpu", number of the submission), each a moment at which work is over.
    """
    own, waited, submitted = [], [], []
    for place, (kind, *rest) in enumerate(asked):
        here = ("cpu", place)
        own.append((("cpu", place - 1), here))
        if kind == "submit":
            queue, _, waits, signals, fence = rest
            number = len(submitted)
            own.append((here, ("gpu", number)))
            for semaphore, value in waits:
                by = [i for i, one in enumerate(submitted) if (semaphore, value) in one[1]]
                waited.append((("gpu", by[-1]), ("gpu", number)))  # of a binary one the last: it is yes or no
            submitted.append((queue, signals, fence))
        elif kind == "wait":
            (by,) = (i for i, one in enumerate(submitted) if (rest[0], rest[1]) in one[1])
            waited.append((("gpu", by), here))
        elif kind == "fence":
            by = [i for i, one in enumerate(submitted) if one[2] == rest[0]]
            waited += [(("gpu", by[-1]), here)] if by else []  # a fence begins signalled
    return own, waited


def unordered(asked, edges):
    """Return pairs that touch the same thing and of which none must come before the other."""
    after = {}
    for first, then in edges:
        after.setdefault(first, []).append(then)

    def reaches(first, goal):
        seen, open_ = {first}, [first]
        while open_:
            for one in after.get(open_.pop(), ()):
                if one == goal:
                    return True
                if one not in seen:
                    seen.add(one)
                    open_.append(one)
        return False

    places = [place for place, one in enumerate(asked) if one[0] == "submit"]
    needed = [
        (("gpu", i), ("gpu", i + 1)) for i in range(len(places) - 1)
    ]  # one field: writer, reader, in turns
    for number, place in enumerate(places):
        for earlier in range(number):
            if asked[places[earlier]][2] == asked[place][2]:  # the same commands are recorded anew
                begun = max(i for i, one in enumerate(asked[:place]) if one[0] == "record") - 1
                needed.append((("gpu", earlier), ("cpu", begun)))
    return [pair for pair in needed if not reaches(*pair)]


@pytest.mark.feature("timeline/support-fallback")
@pytest.mark.parametrize("way", WAYS)
def test_nothing_is_touched_by_two_at_once_and_without_any_one_wait_something_would_be(vulkan_device, way):
    """However slow each part is: of all that the calls allow, whatever a driver makes of it."""
    asked = Asked()
    vulkan_device.fn.trace(asked)
    try:
        with opened(vulkan_device, way) as made:
            asked.clear()
            for time in TIMES:
                made.render(chapters.view_of(made), time)
            asked = list(asked)
    finally:
        vulkan_device.fn.trace(None)
    own, waited = order(asked)
    assert unordered(asked, own + waited) == []
    # A field has a writer and a reader in each frame, and a slot is taken again from the third frame on.
    assert len(waited) == 2 * len(TIMES) - 1 + len(TIMES) - SLOTS
    for one in range(len(waited)):
        assert unordered(asked, own + waited[:one] + waited[one + 1 :]) != [], waited[one]


def test_the_cost_of_pacing_is_measured_for_each_way(vulkan_device):
    told = []
    subject = Subject(WHICH, "vulkan", studies.load(WHICH, None), SIZE, vulkan_device)
    found = measure_pacing(subject, 3, lambda name, part: told.append((name, part)))
    assert [one["way"] for one in found] == list(WAYS)
    for one in found:
        assert 0 < one["wait_best_us"] <= one["wait_us"] and 0 < one["submit_best_us"] <= one["submit_us"]
        assert all(one[name] > 0 for name in COUNTED)
    assert found[-1]["calls"] == found[0]["calls"] + 1 and told[-1] == ("pacing", 1.0)
