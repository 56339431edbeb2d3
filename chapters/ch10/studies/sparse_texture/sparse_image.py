"""The sparse image of the study: tiles of R32UI, each bound to a page of one block of memory, or to none."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from backends.vulkan import api as vk
from backends.vulkan.barriers import transition
from backends.vulkan.device import Device
from backends.vulkan.once import submit_once
from backends.vulkan.resources import FORMATS, Image, create_view, destroy_image
from common.errors import UnsupportedError

from ..sparse_vulkan import bind, page_memory
from . import ACROSS, NONE, PAGE_BYTES, TILE

USAGE = vk.VK_IMAGE_USAGE_SAMPLED_BIT | vk.VK_IMAGE_USAGE_STORAGE_BIT


class SparseImage:
    """A sparse image, the memory of its pages, and the binds of its tiles."""

    def __init__(self, device: Device, pages: int, shared: bool) -> None:
        self._device = device
        self.memory: Any = None
        flags = vk.VK_IMAGE_CREATE_SPARSE_BINDING_BIT | vk.VK_IMAGE_CREATE_SPARSE_RESIDENCY_BIT
        if shared:
            flags |= vk.VK_IMAGE_CREATE_SPARSE_ALIASED_BIT
        side = TILE * ACROSS
        info = vk.new(
            "VkImageCreateInfo",
            flags=flags,
            imageType=vk.VK_IMAGE_TYPE_2D,
            format=FORMATS["r32ui"][0],
            extent={"width": side, "height": side, "depth": 1},
            mipLevels=1,
            arrayLayers=1,
            samples=vk.VK_SAMPLE_COUNT_1_BIT,
            tiling=vk.VK_IMAGE_TILING_OPTIMAL,
            usage=USAGE,
        )
        handle, color = (
            device.create("vkCreateImage", info, "sparse texture"),
            vk.VK_IMAGE_ASPECT_COLOR_BIT,
        )
        self.image = Image(handle, None, "r32ui", side, side, 1, 1, color, None, "sparse texture")
        try:
            requirements = vk.new("VkMemoryRequirements")
            device.fn.vkGetImageMemoryRequirements(device.handle, handle, requirements)
            self._check(requirements)
            self.image.view = create_view(device, self.image, "r32ui")
            self.memory = page_memory(device, requirements, pages, PAGE_BYTES)
            with submit_once(device) as commands:
                transition(device, commands, self.image, "undefined", "storage")
        except BaseException:
            self.close()
            raise

    def _check(self, requirements: Any) -> None:
        """Raise UnsupportedError unless tiles are pages: 128x128 texels and 64 KiB, and nothing beside them."""
        device = self._device
        needed = vk.listed(
            device.fn.vkGetImageSparseMemoryRequirements,
            "vkGetImageSparseMemoryRequirements",
            "VkSparseImageMemoryRequirements",
            device.handle,
            self.image.handle,
        )
        sizes = [part.formatProperties.imageGranularity for part in needed]
        whole = len(needed) == 1 and needed[0].imageMipTailFirstLod > 0
        if (
            not whole
            or (sizes[0].width, sizes[0].height) != (TILE, TILE)
            or requirements.alignment != PAGE_BYTES
        ):
            raise UnsupportedError(
                "The device has other pages than 128x128 texels of 32 bits: see the same picture with --set way=table."
            )

    def bind(self, tiles: NDArray[np.intp], page: NDArray[np.uint32]) -> None:
        """Bind `tiles` (N,) to their pages, `page` by tile; NONE takes the memory away."""
        binds = []
        for tile in tiles.tolist():
            row, column = divmod(tile, ACROSS)
            tile_bind: dict[str, Any] = {
                "subresource": {"aspectMask": vk.VK_IMAGE_ASPECT_COLOR_BIT},
                "offset": {"x": column * TILE, "y": row * TILE},
                "extent": {"width": TILE, "height": TILE, "depth": 1},
            }
            if page[tile] != NONE:
                tile_bind |= {"memory": self.memory, "memoryOffset": int(page[tile]) * PAGE_BYTES}
            binds.append(tile_bind)
        bind(self._device, self.image.handle, None, binds)

    def close(self) -> None:
        """Free image and memory, when no submitted work uses them."""
        destroy_image(self._device, self.image)
        if self.memory is not None:
            self._device.destroy("VkDeviceMemory", self.memory)
            self.memory = None
