"""Frames paced by two timelines: each wait names a value, and the signals are the same for any number of waits."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from backends.vulkan import api as vk
from backends.vulkan.device import Device

from ...frames.queues.vulkan_legacy import LegacySubmit
from ...frames.queues.vulkan_queues import Queues
from ...frames.queues.vulkan_timeline import Timeline, Waiting
from .slots import COMPUTE, EVERYTHING, FRAGMENT, Slot, semaphore_info


class Timelines:
    """A counter for each queue. With `legacy` frames are submitted by the call of Vulkan 1.2."""

    objects = 2

    def __init__(self, device: Device, slots: list[Slot], queues: Queues, legacy: bool = False) -> None:
        self._queues = queues
        self._call: Callable[..., int] = LegacySubmit(device) if legacy else device.fn.vkQueueSubmit2
        self.calls = self.queue_waits = 0
        self._drawn, self._computed = Timeline(device, "graphics"), Timeline(device, "compute")
        self._waiting = Waiting([self._drawn])
        self._infos = {slot.index: (self._compute(slot), self._draw(slot)) for slot in slots}

    def _compute(self, slot: Slot) -> Any:
        return vk.new(
            "VkSubmitInfo2",
            pWaitSemaphoreInfos=[semaphore_info(self._drawn.handle, COMPUTE)],
            pCommandBufferInfos=[{"commandBuffer": slot.beside.commands}],
            pSignalSemaphoreInfos=[semaphore_info(self._computed.handle, EVERYTHING)],
        )

    def _draw(self, slot: Slot) -> Any:
        return vk.new(
            "VkSubmitInfo2",
            pWaitSemaphoreInfos=[semaphore_info(self._computed.handle, FRAGMENT)],
            pCommandBufferInfos=[{"commandBuffer": slot.commands}],
            pSignalSemaphoreInfos=[semaphore_info(self._drawn.handle, EVERYTHING)],
        )

    def wait(self, slot: Slot) -> int:
        """Wait for the value that the slot's last frame signals; the first frames have none to wait for."""
        value = slot.values[0]
        if not value:
            return 0
        self._waiting.values[0] = value
        self._waiting.wait()
        return 1

    def submit(self, slot: Slot) -> None:
        """Submit both command buffers; the frame before signals the last value of its timeline."""
        compute, draw = self._infos[slot.index]
        before, slot.values = self._drawn.last, [self._drawn.next()]
        computed = self._computed.next()
        compute.waitSemaphoreInfoCount = int(before > 0)  # the first frame has no value to wait for
        compute.pWaitSemaphoreInfos[0].value = before
        compute.pSignalSemaphoreInfos[0].value = draw.pWaitSemaphoreInfos[0].value = computed
        draw.pSignalSemaphoreInfos[0].value = slot.values[0]
        for name, info in (("compute", compute), ("graphics", draw)):
            vk.check(self._call(self._queues.of[name].handle, 1, info, vk.NULL), "vkQueueSubmit2")
        self.calls, self.queue_waits = 2, 1 + int(before > 0)

    def close(self) -> None:
        """Free the timelines."""
        self._drawn.close()
        self._computed.close()
