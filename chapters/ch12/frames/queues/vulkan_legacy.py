"""Submission as before Vulkan 1.3: vkQueueSubmit, with the values of timelines in a separate struct.

The old structs have separate lists of semaphores, stages and values, which must agree in length. The lists of values
need an entry for a binary semaphore, too, although it has no value. The stages that wait are a mask of 32 bits, and a
signal comes after all commands.
"""

from __future__ import annotations

from typing import Any

from backends.vulkan import api as vk
from backends.vulkan.device import Device


class LegacySubmit:
    """Replaces `vkQueueSubmit2`: it has the same arguments and result, and calls `vkQueueSubmit`."""

    def __init__(self, device: Device) -> None:
        self._fn = device.fn

    def __call__(self, queue: Any, count: int, infos: Any, fence: Any) -> int:
        """Submit `count` VkSubmitInfo2."""
        old = vk.array("VkSubmitInfo", [as_before(infos[place]) for place in range(count)])
        code: int = self._fn.vkQueueSubmit(queue, count, old, fence)
        return code


def as_before(info: Any) -> Any:
    """Return the VkSubmitInfo that is equivalent to a VkSubmitInfo2."""
    waits = [info.pWaitSemaphoreInfos[place] for place in range(info.waitSemaphoreInfoCount)]
    signals = [info.pSignalSemaphoreInfos[place] for place in range(info.signalSemaphoreInfoCount)]
    values = vk.new(
        "VkTimelineSemaphoreSubmitInfo",
        waitSemaphoreValueCount=len(waits),
        pWaitSemaphoreValues=[semaphore_info.value for semaphore_info in waits] or None,
        signalSemaphoreValueCount=len(signals),
        pSignalSemaphoreValues=[semaphore_info.value for semaphore_info in signals] or None,
    )
    return vk.new(
        "VkSubmitInfo",
        pNext=values,
        waitSemaphoreCount=len(waits),
        pWaitSemaphores=[semaphore_info.semaphore for semaphore_info in waits] or None,
        pWaitDstStageMask=[stages_before(int(semaphore_info.stageMask)) for semaphore_info in waits] or None,
        pCommandBuffers=[
            info.pCommandBufferInfos[place].commandBuffer for place in range(info.commandBufferInfoCount)
        ]
        or None,
        signalSemaphoreCount=len(signals),
        pSignalSemaphores=[semaphore_info.semaphore for semaphore_info in signals] or None,
    )


def stages_before(mask: int) -> int:
    """Return a mask of stages in 32 bits: all commands for stages beyond them, and top of pipe for no stage."""
    if mask >> 32:
        return int(vk.VK_PIPELINE_STAGE_ALL_COMMANDS_BIT)
    return mask or int(vk.VK_PIPELINE_STAGE_TOP_OF_PIPE_BIT)
