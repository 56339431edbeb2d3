"""Timeline semaphores: counters that only rise, on which the CPU and every queue can wait for a value.

One timeline replaces a fence for each frame in flight and a semaphore for each pair of submissions. A submission takes
the `next` value, and the queue signals it after the work. The CPU, or a submission that needs the work, waits until the
counter has reached the value. Any number of waits may use one value, and a wait for a reached value returns at once.

Three rules prevent a deadlock. The signalled values rise strictly. No submission waits for a value that it signals
itself. No wait is for a value that has not been submitted yet. `Waiting.wait` checks the third rule for the CPU;
`frames/queues/vulkan_submission.py` is responsible for the first two.
"""

from __future__ import annotations

from collections.abc import Sequence

from backends.vulkan import api as vk
from backends.vulkan.device import Device
from common.errors import DeviceError

PATIENCE_S, PATIENCE_SOFTWARE_S = 30, 1800
"""The default limit of a wait of the CPU: longer than any frame. Drivers of GPUs stop work that takes seconds; a
software driver may take minutes for a frame."""


class Timeline:
    """A counter that starts at 0. `last` is the highest value that has been reserved for a signal."""

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
        """Reserve the value for the next submission to signal, and return it; the submission must follow."""
        self.last += 1
        return self.last

    @property
    def value(self) -> int:
        """The current value."""
        code = self._device.fn.vkGetSemaphoreCounterValue(self._device.handle, self.handle, self._counter)
        vk.check(code, "vkGetSemaphoreCounterValue")
        return int(self._counter[0])

    def done(self, value: int) -> bool:
        """Whether `value` has been reached, without waiting."""
        return self.value >= value

    def wait(self, value: int, timeout_ns: int | None = None) -> bool:
        """Wait until `value` is reached; see `wait_timelines`."""
        return wait_timelines([(self, value)], timeout_ns=timeout_ns)

    def signal(self, value: int) -> None:
        """Raise the counter from the CPU; ValueError unless `value` is above all reserved values."""
        if value <= self.last:
            raise ValueError(
                f"the {self.name} timeline was told to signal {self.last}: {value} is no step forward"
            )
        self.last, self._signal.value = value, value
        vk.check(self._device.fn.vkSignalSemaphore(self._device.handle, self._signal), "vkSignalSemaphore")

    def close(self) -> None:
        """Free the semaphore, when no pending submission waits for it or signals it."""
        self._device.destroy("VkSemaphore", self.handle)


class Waiting:
    """A reusable wait of the CPU for several timelines: for all of their values or, with `any_of`, for one.

    The caller sets `values` before each wait. A wait for 0 returns at once, since counters start there.
    """

    def __init__(self, timelines: Sequence[Timeline], any_of: bool = False) -> None:
        self._device, self._timelines = timelines[0]._device, tuple(timelines)
        self._needs = any if any_of else all
        self.values = vk.ffi.new("uint64_t[]", len(timelines))
        self._info = vk.new(
            "VkSemaphoreWaitInfo",
            flags=vk.VK_SEMAPHORE_WAIT_ANY_BIT if any_of else 0,
            semaphoreCount=len(timelines),
            pSemaphores=vk.array("VkSemaphore", [timeline.handle for timeline in timelines]),
            pValues=self.values,
        )

    def wait(self, timeout_ns: int | None = None) -> bool:
        """Wait and return True, or False if `timeout_ns` passes first; with 0, only test the values.

        Without `timeout_ns`, raises DeviceError after a default limit, and at once for a value that is not reserved
        yet. With `timeout_ns` a wait for such a value is allowed: it may be reserved later.
        """
        device = self._device
        if timeout_ns is None and not self._needs(
            value <= timeline.last for timeline, value in zip(self._timelines, self.values, strict=True)
        ):
            raise DeviceError(self._stuck("no submission will signal that"))
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
            f"the {timeline.name} timeline stands at {timeline.value} of {value}"
            for timeline, value in zip(self._timelines, self.values, strict=True)
            if value > timeline.value
        )
        return f"The GPU and the CPU wait for each other: {stands}, and {why}; run again with --validate."


def wait_timelines(
    pairs: Sequence[tuple[Timeline, int]], any_of: bool = False, timeout_ns: int | None = None
) -> bool:
    """Wait until all (timeline, value) pairs are reached, or with `any_of` one of them; see `Waiting.wait`."""
    if not pairs:
        return True
    waiting = Waiting([timeline for timeline, _ in pairs], any_of)
    for place, (_, value) in enumerate(pairs):
        waiting.values[place] = value
    return waiting.wait(timeout_ns)
