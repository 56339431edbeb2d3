"""The frames of the study: each slot has commands for both queues, and a `Way` to pace them."""

from __future__ import annotations

from time import perf_counter_ns as now_ns
from typing import Any, Protocol

from backends.vulkan import api as vk
from backends.vulkan.device import Device

from ...frames.frame import SLOTS
from ...frames.queues.vulkan_queues import Queues
from ...frames.vulkan import FrameSlot


class Slot(FrameSlot):
    """A frame in flight: commands for graphics, and in `beside` those for compute."""

    def __init__(self, device: Device, index: int, queues: Queues) -> None:
        super().__init__(device, index)
        self.beside = FrameSlot(device, index, queues.of["compute"])


class Way(Protocol):
    """How frames are paced. `calls` and `queue_waits` are those of the last submission."""

    objects: int
    calls: int
    queue_waits: int

    def wait(self, slot: Slot) -> int:
        """Wait until the GPU is done with a slot; return the number of waits of the CPU."""

    def submit(self, slot: Slot) -> None:
        """Submit both command buffers of a slot: compute after the frame before, graphics after compute."""

    def close(self) -> None:
        """Free its semaphores and fences."""


class Slots:
    """A ring of slots like `frames.vulkan.Frames`, which measures the CPU's times."""

    def __init__(self, device: Device, queues: Queues) -> None:
        self._device = device
        self.slots = [Slot(device, index, queues) for index in range(SLOTS)]
        self.way: Way
        self.number = 0
        self.cpu_waits = self.wait_ns = self.submit_ns = 0
        self._begin = vk.new("VkCommandBufferBeginInfo", flags=vk.VK_COMMAND_BUFFER_USAGE_ONE_TIME_SUBMIT_BIT)

    def begin(self) -> Slot:
        """Return the slot for the next frame, with both command buffers open."""
        slot = self.slots[self.number % SLOTS]
        started = now_ns()
        self.cpu_waits = self.way.wait(slot)
        self.wait_ns = now_ns() - started
        fn, device = self._device.fn, self._device.handle
        for frame_slot in (slot, slot.beside):
            vk.check(fn.vkResetCommandPool(device, frame_slot.pool, 0), "vkResetCommandPool")
            vk.check(fn.vkBeginCommandBuffer(frame_slot.commands, self._begin), "vkBeginCommandBuffer")
        slot.number = self.number
        return slot

    def submit(self, slot: Slot) -> None:
        """Close both command buffers and submit them."""
        for frame_slot in (slot.beside, slot):
            vk.check(self._device.fn.vkEndCommandBuffer(frame_slot.commands), "vkEndCommandBuffer")
        started = now_ns()
        self.way.submit(slot)
        self.submit_ns = now_ns() - started
        self.number += 1

    def wait(self, slot: Slot) -> None:
        """Wait until the GPU is done with a slot."""
        self.way.wait(slot)

    def close(self) -> None:
        """Free everything, after the GPU is done with all slots."""
        for slot in self.slots:
            for frame_slot in (slot, slot.beside):
                self._device.destroy("VkCommandPool", frame_slot.pool)
        self.way.close()


def stages(*names: str) -> int:
    """Return the bits of stages."""
    bits = 0
    for name in names:
        bits |= int(getattr(vk, f"VK_PIPELINE_STAGE_2_{name}_BIT"))
    return bits


COMPUTE, FRAGMENT, EVERYTHING = (
    stages("COMPUTE_SHADER"),
    stages("FRAGMENT_SHADER"),
    stages("ALL_COMMANDS"),
)


def semaphore_info(handle: Any, stage: int) -> dict[str, Any]:
    """Return the entry of a semaphore in a submission."""
    return {"semaphore": handle, "stageMask": stage}
