"""Getting images back to the CPU: copies into CPU-cached memory, and their bytes as numpy."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from backends.vulkan import api as vk
from backends.vulkan.device import Device
from backends.vulkan.resources import FORMATS, Buffer, Image, create_buffer, destroy_buffer
from common.images.packed import unpacked


class Readback:
    """A buffer of the size of one image, with all slices of a 3D one.

    `record` copies the image into it, `read` returns it once that is done.
    """

    def __init__(self, device: Device, image: Image, name: str) -> None:
        self._device = device
        _, texel, self._dtype, self._channels = FORMATS[image.format]
        self._shape = (*(() if image.depth is None else (image.depth,)), image.height, image.width)
        size = math.prod(self._shape) * texel
        self.buffer: Buffer = create_buffer(
            device, size, vk.VK_BUFFER_USAGE_TRANSFER_DST_BIT, "readback", name
        )
        self._image = image
        self._region = vk.new(
            "VkBufferImageCopy",
            imageSubresource={"aspectMask": image.aspect, "layerCount": 1},
            imageExtent={"width": image.width, "height": image.height, "depth": image.depth or 1},
        )

    def record(self, commands: Any) -> None:
        """Record the copy; the image is in state 'copy_source'. A barrier to the host must follow."""
        layout = vk.VK_IMAGE_LAYOUT_TRANSFER_SRC_OPTIMAL
        fn = self._device.fn
        fn.vkCmdCopyImageToBuffer(commands, self._image.handle, layout, self.buffer.handle, 1, self._region)

    def read(self) -> np.ndarray:
        """Return a copy of the image as (H, W) or (H, W, C), row 0 on top; the GPU must have finished the copy.

        A 3D image has its slices in front: (D, H, W, C). Channels that share a word are unpacked.
        """
        self._device.memory.invalidate(self.buffer.allocation)
        values = self.buffer.view(self._dtype)[: math.prod(self._shape) * self._channels]
        shape = self._shape if self._channels == 1 else (*self._shape, self._channels)
        return unpacked(values.reshape(shape).copy(), self._image.format)

    def close(self) -> None:
        """Free the buffer."""
        destroy_buffer(self._device, self.buffer)


TO_HOST = (
    vk.VK_PIPELINE_STAGE_2_ALL_TRANSFER_BIT,
    vk.VK_ACCESS_2_TRANSFER_WRITE_BIT,
    vk.VK_PIPELINE_STAGE_2_HOST_BIT,
    vk.VK_ACCESS_2_HOST_READ_BIT,
)
"""The memory barrier after the last copy: what the GPU copied is there for the CPU once the fence signals."""


def read_image(device: Device, image: Image, state: str) -> np.ndarray:
    """Return an image's level 0 now, waiting for it: for tests and tools. `state` is the image's, before and after."""
    from backends.vulkan.barriers import barriers, transition
    from backends.vulkan.once import submit_once

    readback = Readback(device, image, f"readback of {image.name}")
    try:
        with submit_once(device) as commands:
            transition(device, commands, image, state, "copy_source")
            readback.record(commands)
            device.fn.vkCmdPipelineBarrier2(commands, barriers(memory=TO_HOST))
            transition(device, commands, image, "copy_source", state)
        return readback.read()
    finally:
        readback.close()
