"""Frames in flight: the CPU records one frame while the GPU draws another.

Memory that the CPU writes for a frame exists once per slot. The timelines reach the slot's values when the GPU has
finished the frame; the CPU writes the memory again only after that.
"""

from __future__ import annotations

from typing import Any

from backends.vulkan import api as vk
from backends.vulkan.device import Device, Queue

from .frame import SLOTS, FrameRing
from .queues.vulkan_pace import Pace, submit_info

FOREVER = 2**64 - 1


def create_pool(device: Device, queue: Queue, name: str) -> Any:
    """Return a command pool for short-lived command buffers that are submitted to `queue`."""
    flags = vk.VK_COMMAND_POOL_CREATE_TRANSIENT_BIT
    info = vk.new("VkCommandPoolCreateInfo", flags=flags, queueFamilyIndex=queue.family)
    return device.create("vkCreateCommandPool", info, name)


def allocate_commands(
    device: Device, pool: Any, name: str, level: int = vk.VK_COMMAND_BUFFER_LEVEL_PRIMARY
) -> Any:
    """Return a command buffer of a pool; it lives as long as the pool."""
    info = vk.new("VkCommandBufferAllocateInfo", commandPool=pool, level=level, commandBufferCount=1)
    out = vk.ffi.new("VkCommandBuffer[1]")
    vk.check(device.fn.vkAllocateCommandBuffers(device.handle, info, out), "vkAllocateCommandBuffers")
    device.name("VkCommandBuffer", out[0], name)
    return out[0]


class FrameSlot:
    """A frame slot: the commands of one frame in flight, for one queue, and the timeline values that they signal."""

    batch = 0  # index of the commands' batch in the frame

    def __init__(self, device: Device, index: int, queue: Queue | None = None) -> None:
        self._device, self.index = device, index
        self.number = -1  # of the frame that used the slot last
        # Resetting a whole pool is cheaper than resetting its buffers one by one.
        self.pool = create_pool(device, queue or device.queue, f"frame slot {index}")
        self.commands = allocate_commands(device, self.pool, f"frame slot {index}")
        self.values = [0]
        # Structs of the hot path are built once.
        self.submit = submit_info(self.commands)

    def close(self) -> None:
        """Free the pool."""
        self._device.destroy("VkCommandPool", self.pool)


class Frames(FrameRing):
    """The ring of frame slots. `begin` waits for the next slot and returns it; `submit` submits its commands."""

    def __init__(self, device: Device) -> None:
        self._device, self.pace = device, Pace(device)
        self.slots = [FrameSlot(device, index) for index in range(SLOTS)]
        self._begin = vk.new("VkCommandBufferBeginInfo", flags=vk.VK_COMMAND_BUFFER_USAGE_ONE_TIME_SUBMIT_BIT)

    def begin(self) -> FrameSlot:
        """Return the slot for the next frame, with its command buffer open."""
        slot = self.slots[self.number % SLOTS]
        self.wait(slot)
        fn, device = self._device.fn, self._device.handle
        vk.check(fn.vkResetCommandPool(device, slot.pool, 0), "vkResetCommandPool")
        vk.check(fn.vkBeginCommandBuffer(slot.commands, self._begin), "vkBeginCommandBuffer")
        slot.number = self.number
        return slot

    def submit(self, slot: FrameSlot) -> None:
        """End the slot's command buffer and submit it to the queue, without waiting."""
        fn = self._device.fn
        vk.check(fn.vkEndCommandBuffer(slot.commands), "vkEndCommandBuffer")
        self.pace.send(slot, slot.submit)
        self.number += 1

    def wait(self, slot: FrameSlot) -> None:
        """Wait until the GPU has finished the frame that used `slot` last."""
        self.pace.wait(slot)

    def close(self) -> None:
        """Free the slots and the timelines."""
        super().close()
        self.pace.close()
