"""Timeline semaphores: counters that only rise, on which the CPU and every queue can wait for a value.

One of them does what a fence for each frame in flight and a semaphore for each pair of submissions did before. Whoever
submits work takes the `next` value, and has the queue signal it behind that work; whoever needs the work waits until
the counter has reached the value, however many others wait for it, and at once if it was reached long ago.

Three rules keep a program that does so from standing still: values that are signalled rise strictly, nobody waits for
a value that the same submission signals, and nobody for one that has not been submitted yet. A wait of the CPU holds
to the last one here; the first two are the business of `frames/queues/vulkan_submission.py`.
"""

from __future__ import annotations

from collections.abc import Sequence

from backends.vulkan import api as vk
from backends.vulkan.device import Device
from common.errors import DeviceError

PATIENCE_S, PATIENCE_SOFTWARE_S = 30, 1800
"""How long the CPU waits at most, if it is not told: longer than any frame. Drivers of GPUs stop what takes seconds;
one that draws on the CPU lets a frame take the minutes that it takes."""


class Timeline:
    """A counter that starts at 0. `last` is the highest value that somebody was asked to signal."""

    def __init__(self, device: Device, name: str) -> None:
        self._device, self.name = device, name
        kind = vk.new(
            "VkSemaphoreTypeCreateInfo", semaphoreType=vk.VK_SEMAPHORE_TYPE_TIMELINE, initialValue=0
        )
        info = vk.new("VkSemaphoreCreateInfo", pNext=kind)
        self.handle = device.create("vkCreateSemaphore", info, f"{name} timeline")
        self.last = 0
        self._counter = vk.ffi.new("uint64_t *")
        self._signal = vk.new("VkSemaphoreSignalInfo", semaphore=self.handle)

    def next(self) -> int:
        """Return the value that the next submission signals; it has to be submitted."""
        self.last += 1
        return self.last

    @property
    def value(self) -> int:
        """The value that has been reached."""
        code = self._device.fn.vkGetSemaphoreCounterValue(self._device.handle, self.handle, self._counter)
        vk.check(code, "vkGetSemaphoreCounterValue")
        return int(self._counter[0])

    def done(self, value: int) -> bool:
        """Whether `value` has been reached; nothing is waited for."""
        return self.value >= value

    def wait(self, value: int, timeout_ns: int | None = None) -> bool:
        """Wait until `value` is reached; see `wait_timelines`."""
        return wait_timelines([(self, value)], timeout_ns=timeout_ns)

    def signal(self, value: int) -> None:
        """Raise the counter from the CPU; ValueError unless `value` is above all that were promised."""
        if value <= self.last:
            raise ValueError(
                f"the {self.name} timeline was told to signal {self.last}: {value} is no step forward"
            )
        self.last, self._signal.value = value, value
        vk.check(self._device.fn.vkSignalSemaphore(self._device.handle, self._signal), "vkSignalSemaphore")

    def close(self) -> None:
        """Free it, when nothing that is submitted waits for it or signals it."""
        self._device.destroy("VkSemaphore", self.handle)


class Waiting:
    """A wait of the CPU for several timelines, for all of their values or, with `any_of`, for one; made once.

    `values` are rewritten before each call: a wait for 0 is none, since counters start there.
    """

    def __init__(self, timelines: Sequence[Timeline], any_of: bool = False) -> None:
        self._device, self._timelines = timelines[0]._device, tuple(timelines)
        self._needs = any if any_of else all
        self.values = vk.ffi.new("uint64_t[]", len(timelines))
        self._info = vk.new(
            "VkSemaphoreWaitInfo",
            flags=vk.VK_SEMAPHORE_WAIT_ANY_BIT if any_of else 0,
            semaphoreCount=len(timelines),
            pSemaphores=vk.array("VkSemaphore", [one.handle for one in timelines]),
            pValues=self.values,
        )

    def wait(self, timeout_ns: int | None = None) -> bool:
        """Wait; False where `timeout_ns` went by first, 0 being a question that waits for nothing.

        Without a time DeviceError says, after long enough, what did not come. So it does at once where nobody was
        asked to signal a value: with a time, whoever waits may know of somebody who will be.
        """
        device = self._device
        if timeout_ns is None and not self._needs(
            value <= one.last for one, value in zip(self._timelines, self.values, strict=True)
        ):
            raise DeviceError(self._stuck("nobody was asked to signal that"))
        patience = PATIENCE_SOFTWARE_S if device.capabilities.is_software else PATIENCE_S
        limit = patience * 10**9 if timeout_ns is None else timeout_ns
        code = device.fn.vkWaitSemaphores(device.handle, self._info, limit)
        if vk.check(code, "vkWaitSemaphores") != vk.VK_TIMEOUT:
            return True
        if timeout_ns is None:
            raise DeviceError(self._stuck(f"nothing came in {patience} s"))
        return False

    def _stuck(self, why: str) -> str:
        stands = ", ".join(
            f"the {one.name} timeline stands at {one.value} of {value}"
            for one, value in zip(self._timelines, self.values, strict=True)
            if value > one.value
        )
        return f"The GPU and the CPU wait for each other: {stands}, and {why}; run again with --validate."


def wait_timelines(
    pairs: Sequence[tuple[Timeline, int]], any_of: bool = False, timeout_ns: int | None = None
) -> bool:
    """Wait until all of some (timeline, value) are reached, or `any_of` them; see `Waiting.wait`."""
    if not pairs:
        return True
    waiting = Waiting([one for one, _ in pairs], any_of)
    for place, (_, value) in enumerate(pairs):
        waiting.values[place] = value
    return waiting.wait(timeout_ns)
