"""The pages and the buffers of reports on Vulkan."""

from __future__ import annotations

from contextlib import suppress
from typing import Any

import numpy as np
from numpy.typing import NDArray

from backends.vulkan import api as vk
from backends.vulkan.barriers import transition
from backends.vulkan.memory import MemoryUse
from backends.vulkan.once import submit_once
from backends.vulkan.resources import Buffer, Image
from backends.vulkan.upload import Uploader
from common.errors import UnsupportedError

from .memory import Pages as _Pages
from .memory import ReportMemory as _ReportMemory
from .vulkan_sparse import SparsePages

STORED = vk.VK_IMAGE_USAGE_STORAGE_BIT | vk.VK_IMAGE_USAGE_TRANSFER_SRC_BIT
"""How the pages are used; tests copy them."""


class Pages(_Pages):
    """An image of the renderer's resources."""

    def _create(self, size: tuple[int, int]) -> Image:
        resources, device = self._backend.resources, self._backend.device
        self._handle = resources.image("r32f", size, STORED, "shadow pages", array=True)
        image: Image = resources.images.get(self._handle)
        with submit_once(device) as commands:
            transition(device, commands, image, "undefined", "storage")
        return image

    def close(self) -> None:
        """Give the image up; frames in flight may still use it."""
        self._backend.resources.destroy_image(self._handle)


def make_pages(backend: Any, tiles: int, words: int, sparse: bool) -> _Pages:
    """Return the pages for a table of some words: `tiles` of memory, behind a `sparse` image if the device has one."""
    binds = backend.device.queue.flags & vk.VK_QUEUE_SPARSE_BINDING_BIT
    if sparse and binds and backend.plan.native("sparse"):
        with suppress(UnsupportedError):
            return SparsePages(backend, tiles, words, STORED)
    return Pages(backend, tiles)


class ReportMemory(_ReportMemory):
    """Buffers of the renderer's resources, which free them; the graph sets all barriers."""

    def _create(self, words: int, use: MemoryUse, name: str) -> Buffer:
        usage = vk.VK_BUFFER_USAGE_STORAGE_BUFFER_BIT | vk.VK_BUFFER_USAGE_TRANSFER_DST_BIT
        handle = self._backend.resources.buffer(4 * words, usage, use, name)
        buffer: Buffer = self._backend.resources.buffers.get(handle)
        return buffer

    def _clear(self, buffer: Buffer) -> None:
        with Uploader(self._backend.device) as uploader:
            uploader.buffer(buffer, np.zeros(self._words, np.uint32))

    def _read(self, buffer: Buffer) -> NDArray[np.uint32]:
        assert buffer.allocation is not None, "it is for the CPU"
        self._backend.device.memory.invalidate(buffer.allocation)
        words: NDArray[np.uint32] = buffer.view(np.uint32)[: self._words].copy()
        return words
