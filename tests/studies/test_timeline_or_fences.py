"""The study timeline-or-fences: the same bits in each way, by fewer objects, and what each way asks of the driver."""

from __future__ import annotations

from collections import Counter

import numpy as np
import pytest

import chapters
from backends.vulkan import api as vk
from chapters import studies
from chapters.bench_pacing import COUNTED, measure_pacing
from chapters.ch05.logic.frame import SLOTS
from chapters.ch05.studies.timeline_or_fences import CELLS, WAYS, Settings

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


def test_the_cost_of_pacing_is_measured_for_each_way(vulkan_device):
    told = []
    found = measure_pacing(vulkan_device, 3, lambda name, part: told.append((name, part)))
    assert [one["way"] for one in found] == list(WAYS)
    for one in found:
        assert 0 < one["wait_best_us"] <= one["wait_us"] and 0 < one["submit_best_us"] <= one["submit_us"]
        assert all(one[name] > 0 for name in COUNTED)
    assert found[-1]["calls"] == found[0]["calls"] + 1 and told[-1] == ("pacing", 1.0)
