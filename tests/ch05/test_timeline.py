"""Timelines on their own: what the CPU's waits return, what a queue's signals do, and what is refused."""

from __future__ import annotations

import time

import pytest

from backends.vulkan import api as vk
from chapters.ch05.frames.queues import vulkan_timeline as module
from chapters.ch05.frames.queues.vulkan_timeline import Timeline, wait_timelines
from common.errors import DeviceError
from tests.support.timing import least_time, timed

SHORT = 1_000_000  # ns

pytestmark = pytest.mark.variants("vulkan")


@pytest.fixture
def pair(vulkan_device):
    made = Timeline(vulkan_device, "first"), Timeline(vulkan_device, "second")
    yield made
    for one in made:
        one.close()


def submit(device, signal=None, wait=None):
    """Give the queue work without commands: it waits for (timeline, value) and then signals another one."""

    def infos(pair):
        return [{"semaphore": pair[0].handle, "value": pair[1], "stageMask": 1 << 16}] if pair else None

    info = vk.new("VkSubmitInfo2", pWaitSemaphoreInfos=infos(wait), pSignalSemaphoreInfos=infos(signal))
    vk.check(device.fn.vkQueueSubmit2(device.queue.handle, 1, info, vk.NULL), "vkQueueSubmit2")


@pytest.mark.feature("timeline/cpu-wait")
def test_a_question_is_answered_no_before_the_signal_and_yes_after_it(pair):
    first, _ = pair
    assert first.value == 0 and first.wait(0, 0)
    assert not first.wait(1, 0) and not first.done(1)
    first.signal(1)
    assert first.wait(1, 0) and first.done(1) and first.value == 1
    assert not first.wait(2, 0)


@pytest.mark.alone
@pytest.mark.feature("timeline/cpu-wait")
def test_a_time_out_takes_its_time_and_no_longer(pair):
    def wait():
        assert not pair[0].wait(1, 20 * SHORT)

    assert 0.019 < least_time(timed(wait, clock=time.perf_counter), 2, fewest=1) < 2


@pytest.mark.feature("timeline/cpu-wait")
def test_waiting_for_all_takes_all_and_waiting_for_any_takes_one(pair):
    first, second = pair
    both = [(first, 1), (second, 2)]
    assert not wait_timelines(both, timeout_ns=0) and not wait_timelines(both, any_of=True, timeout_ns=0)
    second.signal(1)
    assert not wait_timelines(both, any_of=True, timeout_ns=0)
    second.signal(2)
    assert wait_timelines(both, any_of=True, timeout_ns=0)
    assert not wait_timelines(both, timeout_ns=0)
    first.signal(1)
    assert wait_timelines(both, timeout_ns=0)
    assert wait_timelines([]) and wait_timelines([(first, 0)], timeout_ns=0)


@pytest.mark.feature("timeline/cpu-wait")
@pytest.mark.feature("timeline/gpu-submit")
def test_the_cpu_waits_for_what_a_queue_signals_and_a_queue_for_the_cpu(vulkan_device, pair):
    """The queue waits for a signal of the CPU; until then nothing behind it happens, and then all of it does."""
    first, second = pair
    submit(vulkan_device, wait=(first, 1), signal=(second, second.next()))
    submit(vulkan_device, signal=(second, second.next()))
    assert not second.wait(1, 5 * SHORT)
    first.signal(1)
    assert second.wait(2), "the default wait waits"
    assert (first.value, second.value) == (1, 2)


def test_a_wait_for_what_was_reached_long_ago_waits_for_nothing(vulkan_device, pair):
    first, _ = pair
    for _ in range(5):
        submit(vulkan_device, signal=(first, first.next()))
    assert first.wait(5)
    assert all(first.wait(value, 0) for value in range(6))


@pytest.mark.feature("timeline/cpu-wait")
def test_what_nobody_will_signal_is_refused_at_once_and_says_who_is_stuck(pair):
    first, second = pair
    first.signal(3)
    with pytest.raises(
        DeviceError,
        match=r"the second timeline stands at 0 of 1, and no submission will signal that; run again",
    ):
        wait_timelines([(first, 3), (second, 1)])
    assert wait_timelines([(first, 3), (second, 1)], any_of=True)


@pytest.mark.feature("timeline/cpu-wait")
def test_what_does_not_come_ends_in_a_sentence_and_not_in_silence(pair, monkeypatch):
    first, _ = pair
    first.next()  # as if something had been submitted that never ends
    for name in ("PATIENCE_S", "PATIENCE_SOFTWARE_S"):
        monkeypatch.setattr(module, name, 0)
    with pytest.raises(DeviceError, match=r"the first timeline stands at 0 of 1, and nothing came in 0 s"):
        first.wait(1)


@pytest.mark.feature("timeline/gpu-submit")
def test_values_only_rise(pair):
    first, _ = pair
    assert [first.next() for _ in range(3)] == [1, 2, 3]
    first.signal(4)
    for value in (4, 3, 0):
        with pytest.raises(ValueError, match="no step forward"):
            first.signal(value)
    assert first.next() == 5
