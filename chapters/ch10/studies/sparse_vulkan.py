"""Sparse memory for studies on Vulkan: memory in pages, and binds on the queue that are waited for.

A bind changes the page table of the GPU. It is work of a queue, like a submission, but only semaphores and fences order
it with other work. These studies wait on both sides: for the frames that still read, and for the bind.
"""

from __future__ import annotations

from collections.abc import Collection
from typing import Any

from backends.vulkan import api as vk
from backends.vulkan.device import Device
from backends.vulkan.driver import features as vf
from backends.vulkan.memory import choose_memory_type


def lacks(device: Device, without: Collection[str], *bits: str) -> str:
    """Return why the device cannot bind pages on its main queue, or ""; `bits` are features that are needed, too."""
    if "sparse" in without:
        return "it is switched off by --without"
    if not device.has("sparse"):
        return device.capabilities.why_not.get("sparse", "the device lacks it")
    if not device.queue.flags & vk.VK_QUEUE_SPARSE_BINDING_BIT:
        return "its graphics queue cannot bind memory"
    return device.physical.lacks(vf.Requirement(bits=tuple((vf.CORE, bit) for bit in bits))) or ""


def page_memory(device: Device, requirements: Any, pages: int, page: int) -> Any:
    """Return a VkDeviceMemory of so many pages of `page` bytes, for a resource with these VkMemoryRequirements."""
    kind = choose_memory_type(device.memory.types, requirements.memoryTypeBits, "device")
    info = vk.new("VkMemoryAllocateInfo", allocationSize=pages * page, memoryTypeIndex=kind)
    return device.create("vkAllocateMemory", info, f"{pages} pages")


def bind(device: Device, image: Any, buffer: Any, binds: list[dict[str, Any]]) -> None:
    """Bind pages of an image or a buffer (the other is None) to memory, or to none, and wait until it is done.

    The GPU must have finished all work that uses these pages.
    """
    if not binds:
        return
    info = (
        vk.new("VkBindSparseInfo", pImageBinds=[{"image": image, "pBinds": binds}], imageBindCount=1)
        if buffer is None
        else vk.new("VkBindSparseInfo", pBufferBinds=[{"buffer": buffer, "pBinds": binds}], bufferBindCount=1)
    )
    done = device.create("vkCreateFence", vk.new("VkFenceCreateInfo"), "pages bound")
    try:
        vk.check(device.fn.vkQueueBindSparse(device.queue.handle, 1, info, done), "vkQueueBindSparse")
        fences = vk.array("VkFence", [done])
        vk.check(device.fn.vkWaitForFences(device.handle, 1, fences, 1, 2**64 - 1), "vkWaitForFences")
    finally:
        device.destroy("VkFence", done)
