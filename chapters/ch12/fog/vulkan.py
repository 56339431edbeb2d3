"""The memory of fog on Vulkan."""

from __future__ import annotations

import numpy as np

from backends.vulkan import api as vk
from backends.vulkan.resources import Buffer
from backends.vulkan.upload import Uploader

from .memory import BLOCK
from .memory import FogMemory as _FogMemory

_STORED = (
    vk.VK_BUFFER_USAGE_STORAGE_BUFFER_BIT
    | vk.VK_BUFFER_USAGE_TRANSFER_DST_BIT
    | vk.VK_BUFFER_USAGE_TRANSFER_SRC_BIT
)


class FogMemory(_FogMemory):
    """Buffers of the renderer's resources, which free them."""

    def _create_block(self, name: str) -> Buffer:
        resources, usage = self._backend.resources, vk.VK_BUFFER_USAGE_UNIFORM_BUFFER_BIT
        buffer: Buffer = resources.buffers.get(resources.buffer(BLOCK.itemsize, usage, "upload", name))
        return buffer

    def _create_buffer(self, size: int, beginning: np.ndarray, name: str) -> Buffer:
        resources = self._backend.resources
        self._handle = resources.buffer(size, _STORED, "device", name)  # of the store, which is made last
        buffer: Buffer = resources.buffers.get(self._handle)
        with Uploader(self._backend.device) as uploader:
            uploader.buffer(buffer, beginning)
        return buffer

    def _free_store(self) -> None:
        if self.store is not None:
            self._backend.resources.destroy_buffer(self._handle)
        self.store = None
