"""Submitting as before Vulkan 1.3: vkQueueSubmit, with the values of timelines in a struct beside it.

In the old struct semaphores, stages and values are four lists that must agree, and the last two say nothing of a binary
semaphore but need a place for it all the same. What a wait holds back is named in 32 bits, and a signal comes behind
everything.
"""

from __future__ import annotations

from typing import Any

from backends.vulkan import api as vk
from backends.vulkan.device import Device


class LegacySubmit:
    """Stands in the place of `vkQueueSubmit2`, with its arguments and its result, and calls `vkQueueSubmit`."""

    def __init__(self, device: Device) -> None:
        self._fn = device.fn

    def __call__(self, queue: Any, count: int, infos: Any, fence: Any) -> int:
        """Submit `count` VkSubmitInfo2."""
        old = vk.array("VkSubmitInfo", [as_before(infos[place]) for place in range(count)])
        code: int = self._fn.vkQueueSubmit(queue, count, old, fence)
        return code


def as_before(info: Any) -> Any:
    """Return the VkSubmitInfo that asks for the same as a VkSubmitInfo2."""
    waits = [info.pWaitSemaphoreInfos[place] for place in range(info.waitSemaphoreInfoCount)]
    signals = [info.pSignalSemaphoreInfos[place] for place in range(info.signalSemaphoreInfoCount)]
    values = vk.new(
        "VkTimelineSemaphoreSubmitInfo",
        waitSemaphoreValueCount=len(waits),
        pWaitSemaphoreValues=[one.value for one in waits] or None,
        signalSemaphoreValueCount=len(signals),
        pSignalSemaphoreValues=[one.value for one in signals] or None,
    )
    return vk.new(
        "VkSubmitInfo",
        pNext=values,
        waitSemaphoreCount=len(waits),
        pWaitSemaphores=[one.semaphore for one in waits] or None,
        pWaitDstStageMask=[stages_before(int(one.stageMask)) for one in waits] or None,
        pCommandBuffers=[
            info.pCommandBufferInfos[place].commandBuffer for place in range(info.commandBufferInfoCount)
        ]
        or None,
        signalSemaphoreCount=len(signals),
        pSignalSemaphores=[one.semaphore for one in signals] or None,
    )


def stages_before(mask: int) -> int:
    """Return stages in 32 bits: those that have none there stand for everything, and no stage for the first of all."""
    if mask >> 32:
        return int(vk.VK_PIPELINE_STAGE_ALL_COMMANDS_BIT)
    return mask or int(vk.VK_PIPELINE_STAGE_TOP_OF_PIPE_BIT)
