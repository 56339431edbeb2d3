"""Buffers of the GPU, read back after all frames."""

from __future__ import annotations

from typing import Any

import numpy as np

from backends.gl import api as gl
from backends.gl.context import Context
from backends.gl.resources import read_buffer
from backends.vulkan import api as vk
from backends.vulkan.barriers import barriers
from backends.vulkan.once import submit_once
from backends.vulkan.readback import TO_HOST
from backends.vulkan.resources import create_buffer, destroy_buffer


def read_words(device: Any, buffer: Any) -> np.ndarray:
    """Return the words of a buffer; on Vulkan it was made as a source of copies."""
    if isinstance(device, Context):
        device.fn.glMemoryBarrier(gl.GL_BUFFER_UPDATE_BARRIER_BIT)
        found: np.ndarray = read_buffer(device, buffer, np.uint32)
        return found
    device.wait_idle()
    copied = create_buffer(
        device, buffer.size, vk.VK_BUFFER_USAGE_TRANSFER_DST_BIT, "readback", f"{buffer.name}, read"
    )
    try:
        with submit_once(device) as commands:
            region = vk.new("VkBufferCopy", size=buffer.size)
            device.fn.vkCmdCopyBuffer(commands, buffer.handle, copied.handle, 1, region)
            device.fn.vkCmdPipelineBarrier2(commands, barriers(memory=TO_HOST))
        device.memory.invalidate(copied.allocation)
        return copied.view(np.uint32).copy()
    finally:
        destroy_buffer(device, copied)
