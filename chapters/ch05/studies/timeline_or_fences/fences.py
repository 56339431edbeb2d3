"""Frames paced as before Vulkan 1.2: a fence for each slot, and for each slot a semaphore for each pair of submissions.

A wait resets a binary semaphore. So each has one submission that signals it and one that waits for it, in turns; a
second wait would need a second semaphore. A fence stays signalled until it is reset. It must be reset before each
submission, and not earlier: without a submission after the reset it would never be signalled again.
"""

from __future__ import annotations

from typing import Any

from backends.vulkan import api as vk
from backends.vulkan.device import Device

from ...frames.frame import SLOTS
from ...frames.queues.vulkan_queues import Queues
from .slots import COMPUTE, EVERYTHING, FRAGMENT, Slot, semaphore_info

FOREVER = 2**64 - 1


class Fences:
    """Three objects for each slot: a semaphore for its kernel, one for its picture, and a fence for the CPU."""

    objects = 3 * SLOTS

    def __init__(self, device: Device, slots: list[Slot], queues: Queues) -> None:
        self._device, self._queues = device, queues
        self.calls = self.queue_waits = 0
        signalled = vk.new("VkFenceCreateInfo", flags=vk.VK_FENCE_CREATE_SIGNALED_BIT)
        self._fences = [
            vk.array("VkFence", [device.create("vkCreateFence", signalled, f"slot {slot.index} left")])
            for slot in slots
        ]
        self._computed = [self._semaphore(f"slot {slot.index} computed") for slot in slots]
        self._drawn = [self._semaphore(f"slot {slot.index} drawn") for slot in slots]
        self._infos = {slot.index: (self._compute(slot), self._draw(slot)) for slot in slots}

    def _semaphore(self, name: str) -> Any:
        return self._device.create("vkCreateSemaphore", vk.new("VkSemaphoreCreateInfo"), name)

    def _compute(self, slot: Slot) -> Any:
        before = (slot.index - 1) % SLOTS
        return vk.new(
            "VkSubmitInfo2",
            pWaitSemaphoreInfos=[semaphore_info(self._drawn[before], COMPUTE)],
            pCommandBufferInfos=[{"commandBuffer": slot.beside.commands}],
            pSignalSemaphoreInfos=[semaphore_info(self._computed[slot.index], EVERYTHING)],
        )

    def _draw(self, slot: Slot) -> Any:
        return vk.new(
            "VkSubmitInfo2",
            pWaitSemaphoreInfos=[semaphore_info(self._computed[slot.index], FRAGMENT)],
            pCommandBufferInfos=[{"commandBuffer": slot.commands}],
            pSignalSemaphoreInfos=[semaphore_info(self._drawn[slot.index], EVERYTHING)],
        )

    def wait(self, slot: Slot) -> int:
        """Wait for the slot's fence, which begins signalled."""
        fn, fences = self._device.fn, self._fences[slot.index]
        vk.check(fn.vkWaitForFences(self._device.handle, 1, fences, 1, FOREVER), "vkWaitForFences")
        return 1

    def submit(self, slot: Slot) -> None:
        """Submit both command buffers; the kernel of the first frame has no frame before it to wait for."""
        fn, fences = self._device.fn, self._fences[slot.index]
        vk.check(fn.vkResetFences(self._device.handle, 1, fences), "vkResetFences")
        compute, draw = self._infos[slot.index]
        compute.waitSemaphoreInfoCount = int(slot.number > 0)
        queue = self._queues.of["compute"].handle
        vk.check(fn.vkQueueSubmit2(queue, 1, compute, vk.NULL), "vkQueueSubmit2")
        queue = self._queues.of["graphics"].handle
        vk.check(fn.vkQueueSubmit2(queue, 1, draw, fences[0]), "vkQueueSubmit2")
        self.calls, self.queue_waits = 3, 1 + int(slot.number > 0)

    def close(self) -> None:
        """Free all of them."""
        for fences in self._fences:
            self._device.destroy("VkFence", fences[0])
        for semaphore in (*self._computed, *self._drawn):
            self._device.destroy("VkSemaphore", semaphore)
