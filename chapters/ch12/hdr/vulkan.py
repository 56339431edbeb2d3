"""The buffers of the exposure on Vulkan."""

from __future__ import annotations

import numpy as np

from backends.vulkan import api as vk
from backends.vulkan.memory import MemoryUse
from backends.vulkan.resources import Buffer
from backends.vulkan.upload import Uploader

from .memory import ExposureMemory as _ExposureMemory

_USAGE = (
    vk.VK_BUFFER_USAGE_UNIFORM_BUFFER_BIT
    | vk.VK_BUFFER_USAGE_STORAGE_BUFFER_BIT
    | vk.VK_BUFFER_USAGE_TRANSFER_DST_BIT
)


class ExposureMemory(_ExposureMemory):
    """Buffers of the renderer's resources, which free them; the graph sets all barriers."""

    def _create(self, size: int, use: MemoryUse, name: str) -> Buffer:
        resources = self._backend.resources
        buffer: Buffer = resources.buffers.get(resources.buffer(size, _USAGE, use, name))
        return buffer

    def _clear(self, buffer: Buffer) -> None:
        with Uploader(self._backend.device) as uploader:
            uploader.buffer(buffer, np.zeros(buffer.size // 4, np.uint32))

    def _read(self, buffer: Buffer) -> np.ndarray:
        assert buffer.allocation is not None, "the CPU reads it"
        self._backend.device.memory.invalidate(buffer.allocation)
        return buffer.view(np.float32).copy()
