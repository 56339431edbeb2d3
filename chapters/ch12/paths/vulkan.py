"""The memory of paths on Vulkan."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from backends.vulkan import api as vk
from backends.vulkan.resources import Buffer
from backends.vulkan.upload import Uploader

from .memory import PathMemory as _PathMemory


class PathMemory(_PathMemory):
    """Buffers of the renderer's resources, which free them."""

    def _create_block(self, size: int, name: str) -> Buffer:
        resources, usage = self._backend.resources, vk.VK_BUFFER_USAGE_UNIFORM_BUFFER_BIT
        buffer: Buffer = resources.buffers.get(resources.buffer(size, usage, "upload", name))
        return buffer

    def _create_tables(self, words: NDArray[np.uint32]) -> Buffer:
        resources = self._backend.resources
        usage = vk.VK_BUFFER_USAGE_STORAGE_BUFFER_BIT | vk.VK_BUFFER_USAGE_TRANSFER_DST_BIT
        buffer: Buffer = resources.buffers.get(
            resources.buffer(words.nbytes, usage, "device", "tables of paths")
        )
        self._fill(buffer, words)
        return buffer

    def _create_told(self, size: int, name: str) -> Buffer:
        resources, usage = self._backend.resources, vk.VK_BUFFER_USAGE_STORAGE_BUFFER_BIT
        buffer: Buffer = resources.buffers.get(resources.buffer(size, usage, "readback", name))
        return buffer

    def _read(self, buffer: Buffer) -> NDArray[np.float32]:
        assert buffer.allocation is not None, "the CPU reads it"
        self._backend.device.memory.invalidate(buffer.allocation)
        return buffer.view(np.float32).copy()

    def _write_tables(self, buffer: Buffer, words: NDArray[np.uint32]) -> None:
        self._backend.device.wait_idle()
        self._fill(buffer, words)

    def _fill(self, buffer: Buffer, words: NDArray[np.uint32]) -> None:
        with Uploader(self._backend.device) as uploader:
            uploader.buffer(buffer, words)
