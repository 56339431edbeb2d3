"""A command buffer that is recorded, submitted and waited for once: for loading, tests and tools, never for a frame."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from backends.vulkan import api as vk
from backends.vulkan.device import Device, Queue


@contextmanager
def submit_once(device: Device, queue: Queue | None = None) -> Iterator[Any]:
    """Give an open command buffer; on leaving without an exception, submit it and wait until the GPU is done.

    It goes to the device's main queue, if to no other.
    """
    fn, queue = device.fn, queue or device.queue
    pool_info = vk.new(
        "VkCommandPoolCreateInfo",
        flags=vk.VK_COMMAND_POOL_CREATE_TRANSIENT_BIT,
        queueFamilyIndex=queue.family,
    )
    pool = device.create("vkCreateCommandPool", pool_info, "one-time commands")
    fence = device.create("vkCreateFence", vk.new("VkFenceCreateInfo"), "one-time commands done")
    try:
        info = vk.new("VkCommandBufferAllocateInfo", commandPool=pool, commandBufferCount=1)
        out = vk.ffi.new("VkCommandBuffer[1]")
        vk.check(fn.vkAllocateCommandBuffers(device.handle, info, out), "vkAllocateCommandBuffers")
        begin = vk.new("VkCommandBufferBeginInfo", flags=vk.VK_COMMAND_BUFFER_USAGE_ONE_TIME_SUBMIT_BIT)
        vk.check(fn.vkBeginCommandBuffer(out[0], begin), "vkBeginCommandBuffer")
        yield out[0]
        vk.check(fn.vkEndCommandBuffer(out[0]), "vkEndCommandBuffer")
        submit = vk.new("VkSubmitInfo2", pCommandBufferInfos=[{"commandBuffer": out[0]}])
        vk.check(fn.vkQueueSubmit2(queue.handle, 1, submit, fence), "vkQueueSubmit2")
        fences = vk.array("VkFence", [fence])
        vk.check(fn.vkWaitForFences(device.handle, 1, fences, 1, 2**64 - 1), "vkWaitForFences")
    finally:
        device.destroy("VkFence", fence)
        device.destroy("VkCommandPool", pool)
