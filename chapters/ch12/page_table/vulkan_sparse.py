"""Pages by sparse residency: one large image, whose tiles have memory where the table says so (Vulkan).

Every word of the table that is shown has a place of its own in the image, and every tile one more for when it is kept
(pool.py). The driver's page table takes the part of ours: binding a tile of memory to a place is an operation of the
queue. A frame that needs other tiles waits for it on the GPU, by a timeline. Memory comes in blocks, as it is needed.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from backends.vulkan import api as vk
from backends.vulkan.barriers import transition
from backends.vulkan.once import submit_once
from backends.vulkan.resources import Image, create_view
from common.errors import DeviceError, UnsupportedError

from ..frames.queues.vulkan_pace import ALL_COMMANDS
from ..frames.queues.vulkan_timeline import Timeline
from ..shadows.layout import WIDEST
from ..shadows.model import TILE, TILE_BYTES
from .memory import Pages
from .pool import TilePool, places_of
from .refusal import refused

BLOCK = 64
"""Tiles of a block of memory: 4 MiB."""

BIND = np.dtype(
    {
        "names": ["aspect", "layer", "x", "y", "width", "height", "depth", "memory", "at"],
        "formats": ["u4", "u4", "i4", "i4", "u4", "u4", "u4", "u8", "u8"],
        "offsets": [0, 8, 12, 16, 24, 28, 32, 40, 48],
        "itemsize": 64,
    }
)
"""VkSparseImageMemoryBind: arrays of it are filled as a whole."""


class SparsePages(Pages):
    """A sparse image with a place for each word of the table.

    Raises UnsupportedError if the device has none as large, or other pages.
    """

    def __init__(self, backend: Any, tiles: int, words: int, usage: int) -> None:
        assert vk.ffi.sizeof("VkSparseImageMemoryBind") == BIND.itemsize, (
            "the layout above is that of the API"
        )
        self._usage, self._words, self._places = usage, words, words + tiles
        rows = -(-self._places // WIDEST)
        self._layers = -(-rows // WIDEST)
        self._rows = -(-rows // self._layers)
        self._blocks: list[int] = []  # handles of memory as integers, as BIND has them
        self._memories: list[Any] = []
        self._bound = np.full(self._places, -1, np.int64)
        super().__init__(backend, tiles)
        self.columns_rows = WIDEST, self._rows
        self.virtual = places_of(np.arange(self._places), WIDEST, self._rows)
        self._timeline = Timeline(backend.device, "sparse binds")
        self._revision = -1

    def _create(self, size: tuple[int, int]) -> Image:
        device, (width, height) = self._backend.device, (WIDEST * TILE, self._rows * TILE)
        limits = device.physical.limits
        fits = max(width, height) <= limits.maxImageDimension2D and self._layers <= limits.maxImageArrayLayers
        if not fits or self._places * TILE_BYTES > limits.sparseAddressSpaceSize:
            raise UnsupportedError("The device has no sparse image as large as the table.")
        info = vk.new(
            "VkImageCreateInfo",
            flags=vk.VK_IMAGE_CREATE_SPARSE_BINDING_BIT | vk.VK_IMAGE_CREATE_SPARSE_RESIDENCY_BIT,
            imageType=vk.VK_IMAGE_TYPE_2D,
            format=vk.VK_FORMAT_R32_SFLOAT,
            extent={"width": width, "height": height, "depth": 1},
            mipLevels=1,
            arrayLayers=self._layers,
            samples=vk.VK_SAMPLE_COUNT_1_BIT,
            tiling=vk.VK_IMAGE_TILING_OPTIMAL,
            usage=self._usage,
        )
        name, aspect = "shadow pages", vk.VK_IMAGE_ASPECT_COLOR_BIT
        handle = device.create("vkCreateImage", info, name)
        image = Image(handle, None, "r32f", width, height, 1, self._layers, aspect, None, name, array=True)
        self._handle = self._backend.resources.images.create(image)
        if _page_of(device, handle) != (TILE, TILE, TILE_BYTES):
            self._backend.resources.destroy_image(self._handle)
            raise UnsupportedError("The pages of the device are no squares of 128 texels.")
        image.view = create_view(device, image, "r32f")
        with submit_once(device) as commands:
            transition(device, commands, image, "undefined", "storage")
        return image

    def reserve(self, tiles: int) -> int:
        """Have memory for so many tiles, or for as many as the device gives; return their number."""
        device = self._backend.device
        while len(self._blocks) * BLOCK < tiles:
            requirements = vk.new("VkMemoryRequirements")
            device.fn.vkGetImageMemoryRequirements(device.handle, self.image.handle, requirements)
            bits, local = int(requirements.memoryTypeBits), vk.VK_MEMORY_PROPERTY_DEVICE_LOCAL_BIT
            kinds = [i for i, kind in enumerate(device.memory.types) if bits >> i & 1]
            kinds.sort(key=lambda i: not device.memory.types[i].flags & local)
            info = vk.new("VkMemoryAllocateInfo", allocationSize=BLOCK * TILE_BYTES, memoryTypeIndex=kinds[0])
            try:
                memory = device.create("vkAllocateMemory", info, f"shadow pages {len(self._blocks)}")
            except DeviceError as error:
                if not refused(error):
                    raise
                break
            self._memories.append(memory)
            self._blocks.append(int(vk.ffi.cast("uintptr_t", memory)))
        return len(self._blocks) * BLOCK

    def bind(self, pool: TilePool) -> None:
        """Bind tiles to the places that have others now; the next submission waits for it.

        A place without a tile keeps its last one bound until that one is free: a frame in flight may read it.
        """
        if pool.revision == self._revision:
            return
        self._revision = pool.revision
        wanted = np.full(self._places, -1, np.int64)
        wanted[: self._words] = pool.tile_of[: self._words]
        kept = pool.tile_of[self._words :]
        kept = kept[kept >= 0]
        wanted[self._words + kept] = kept
        gone = (wanted < 0) & (self._bound >= 0)
        gone[gone] = ~pool.is_waiting[self._bound[gone]]
        new = (wanted >= 0) & (wanted != self._bound)
        numbers = np.concatenate([np.flatnonzero(gone), np.flatnonzero(new)])
        if not len(numbers):
            return
        self._submit(self._binds(numbers, wanted[numbers]))
        self._bound[numbers] = wanted[numbers]

    def _binds(self, numbers: NDArray[np.intp], tiles: NDArray[np.int64]) -> np.ndarray:
        """Return the (N,) BIND records that give tiles to places; a tile of -1 takes the memory away."""
        assert self.virtual is not None, "the image has places"
        places = self.virtual[numbers]
        binds = np.zeros(len(numbers), BIND)
        binds["aspect"], binds["layer"] = vk.VK_IMAGE_ASPECT_COLOR_BIT, places >> 16
        binds["x"], binds["y"] = (places & 0xFF) * TILE, (places >> 8 & 0xFF) * TILE
        binds["width"] = binds["height"] = TILE
        binds["depth"] = 1
        held = np.maximum(tiles, 0)
        memory = np.array(self._blocks or [0], np.uint64)[held // BLOCK]
        binds["memory"] = np.where(tiles < 0, np.uint64(0), memory)
        binds["at"] = np.where(tiles < 0, 0, held % BLOCK * TILE_BYTES)
        return binds

    def _submit(self, binds: np.ndarray) -> None:
        """Bind on the queue, and let what is submitted afterwards wait: a wait counts for all later submissions."""
        device = self._backend.device
        value = self._timeline.next()
        pointer = vk.ffi.cast("VkSparseImageMemoryBind *", vk.ffi.from_buffer(binds))
        image_bind = vk.ffi.new("VkSparseImageMemoryBindInfo[1]")
        image_bind[0].image, image_bind[0].bindCount, image_bind[0].pBinds = (
            self.image.handle,
            len(binds),
            pointer,
        )
        values = vk.new(
            "VkTimelineSemaphoreSubmitInfo", pSignalSemaphoreValues=[value], signalSemaphoreValueCount=1
        )
        info = vk.new(
            "VkBindSparseInfo",
            pNext=values,
            pSignalSemaphores=[self._timeline.handle],
            signalSemaphoreCount=1,
        )
        info.imageBindCount, info.pImageBinds = 1, image_bind
        queue = device.queue.handle
        vk.check(device.fn.vkQueueBindSparse(queue, 1, info, vk.NULL), "vkQueueBindSparse")
        waits = [{"semaphore": self._timeline.handle, "value": value, "stageMask": ALL_COMMANDS}]
        after = vk.new("VkSubmitInfo2", pWaitSemaphoreInfos=waits, waitSemaphoreInfoCount=1)
        vk.check(device.fn.vkQueueSubmit2(queue, 1, after, vk.NULL), "vkQueueSubmit2")

    def bytes(self, pool: TilePool) -> int:
        """Return the bytes of the tiles that have an owner."""
        return pool.used * TILE_BYTES

    def close(self) -> None:
        """Give everything up; frames in flight may still use it."""
        resources, device = self._backend.resources, self._backend.device
        resources.destroy_image(self._handle)
        for memory in self._memories:
            resources.defer(lambda memory=memory: device.destroy("VkDeviceMemory", memory))
        resources.defer(self._timeline.close)


def _page_of(device: Any, image: Any) -> tuple[int, int, int]:
    """Return width and height of the pages of an image in texels, and their bytes; zeros if it has none."""
    kinds = vk.listed(
        device.fn.vkGetImageSparseMemoryRequirements,
        "vkGetImageSparseMemoryRequirements",
        "VkSparseImageMemoryRequirements",
        device.handle,
        image,
    )
    requirements = vk.new("VkMemoryRequirements")
    device.fn.vkGetImageMemoryRequirements(device.handle, image, requirements)
    for kind in kinds:
        if kind.formatProperties.aspectMask & vk.VK_IMAGE_ASPECT_COLOR_BIT and kind.imageMipTailFirstLod:
            granularity = kind.formatProperties.imageGranularity
            return int(granularity.width), int(granularity.height), int(requirements.alignment)
    return 0, 0, 0
