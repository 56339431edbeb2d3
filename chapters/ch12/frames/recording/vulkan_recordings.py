"""Frames that are recorded once and submitted again, until something in the recording changes.

Data that changes in each frame (camera, moving objects, the order of transparent ones) is in buffers of the slot, which
the recording reads from fixed addresses. Commands that change in each frame (copies of deformed vertices) have a small
command buffer of their own, submitted before the recording in the same call.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from backends.vulkan import api as vk
from backends.vulkan.device import Device

from ..frame import SLOTS
from ..queues.vulkan_pace import Pace, submit_info
from ..vulkan import Frames, FrameSlot, allocate_commands, create_pool


class RecordedSlot(FrameSlot):
    """A frame slot with its recording; `key` identifies what was recorded, None if there is no valid recording."""

    def __init__(self, device: Device, index: int) -> None:
        super().__init__(device, index)
        self.key: Any = None
        self.work: dict[str, int] = {}
        """The counters of the recording."""
        self.upload_pool = create_pool(device, device.queue, f"uploads, slot {index}")
        self.uploads = allocate_commands(device, self.upload_pool, f"uploads, slot {index}")
        both = self.uploads, self.commands
        self.submit_both = submit_info(*both)
        self.uploading = False

    def close(self) -> None:
        """Free the pools."""
        self._device.destroy("VkCommandPool", self.upload_pool)
        super().close()


class Recordings(Frames):
    """The ring of frame slots. `begin` returns the next slot with its recording; `submit` submits it again."""

    forgotten = 0
    """How often all recordings became invalid."""

    def __init__(self, device: Device) -> None:
        self._device, self.pace = device, Pace(device)
        self.slots: list[Any] = [RecordedSlot(device, index) for index in range(SLOTS)]
        self._once = vk.new("VkCommandBufferBeginInfo", flags=vk.VK_COMMAND_BUFFER_USAGE_ONE_TIME_SUBMIT_BIT)
        self._again = vk.new("VkCommandBufferBeginInfo")

    def begin(self) -> RecordedSlot:
        """Return the slot for the next frame, after the GPU has finished with it."""
        slot: RecordedSlot = self.slots[self.number % SLOTS]
        self.wait(slot)
        slot.number = self.number
        slot.uploading = False
        return slot

    @contextmanager
    def recording(self, slot: RecordedSlot, key: Any) -> Iterator[Any]:
        """Record the slot's commands anew, valid for `key`. After an error the slot has no recording."""
        fn, device = self._device.fn, self._device.handle
        slot.key = None
        vk.check(fn.vkResetCommandPool(device, slot.pool, 0), "vkResetCommandPool")
        vk.check(fn.vkBeginCommandBuffer(slot.commands, self._again), "vkBeginCommandBuffer")
        yield slot.commands
        vk.check(fn.vkEndCommandBuffer(slot.commands), "vkEndCommandBuffer")
        slot.key = key

    def uploads(self, slot: RecordedSlot) -> Any:
        """Return a command buffer that runs in this frame only, before the recording."""
        if not slot.uploading:
            fn = self._device.fn
            vk.check(fn.vkResetCommandPool(self._device.handle, slot.upload_pool, 0), "vkResetCommandPool")
            vk.check(fn.vkBeginCommandBuffer(slot.uploads, self._once), "vkBeginCommandBuffer")
            slot.uploading = True
        return slot.uploads

    def submit(self, slot: Any) -> None:
        """Submit the slot's recording to the queue, after its uploads if there are any, without waiting."""
        fn = self._device.fn
        if slot.uploading:
            vk.check(fn.vkEndCommandBuffer(slot.uploads), "vkEndCommandBuffer")
        self.pace.send(slot, slot.submit_both if slot.uploading else slot.submit)
        self.number += 1

    def forget(self) -> None:
        """Invalidate the recordings of all slots: something that is recorded has changed."""
        self.forgotten += 1
        for slot in self.slots:
            slot.key = None
