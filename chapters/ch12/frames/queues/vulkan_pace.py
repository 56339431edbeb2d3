"""The pace of frames: the timeline values that submissions signal, and the wait for those of a slot's last frame."""

from __future__ import annotations

from typing import Any

from backends.vulkan import api as vk
from backends.vulkan.device import Device

from .vulkan_timeline import Timeline, Waiting

ALL_COMMANDS = int(vk.VK_PIPELINE_STAGE_2_ALL_COMMANDS_BIT)


def submit_info(*commands: Any) -> Any:
    """Return a VkSubmitInfo2 of command buffers with one signal after them; it is created once, and rewritten."""
    return vk.new(
        "VkSubmitInfo2",
        pCommandBufferInfos=[{"commandBuffer": command_buffer} for command_buffer in commands],
        pSignalSemaphoreInfos=[{"stageMask": ALL_COMMANDS}],
    )


class Pace:
    """The timelines that pace the frames, one for each queue in `names`; for graphics only by default."""

    def __init__(self, device: Device, *names: str) -> None:
        self._device = device
        self.timelines = {name: Timeline(device, name) for name in names or ("graphics",)}
        self._waiting = Waiting(list(self.timelines.values()))

    def send(self, slot: Any, info: Any) -> None:
        """Submit a frame of one batch to the graphics queue."""
        timeline = self.timelines["graphics"]
        value = sign(info, timeline)
        queue = self._device.queue.handle
        vk.check(self._device.fn.vkQueueSubmit2(queue, 1, info, vk.NULL), "vkQueueSubmit2")
        slot.values = [value]

    def wait(self, slot: Any) -> None:
        """Wait for the values of the slot's last frame; return at once before its first frame."""
        if any(slot.values):
            self._waiting.values[0 : len(slot.values)] = slot.values
            self._waiting.wait()
            slot.values = [0] * len(slot.values)  # reached: another wait is not needed

    def close(self) -> None:
        """Free the timelines."""
        for timeline in self.timelines.values():
            timeline.close()


def sign(info: Any, timeline: Timeline) -> int:
    """Set a VkSubmitInfo2 to signal the next value of a timeline; return the value."""
    signal, value = info.pSignalSemaphoreInfos[0], timeline.next()
    signal.semaphore, signal.value = timeline.handle, value
    return value
