"""The study wavefront on Vulkan: the frame of renderer.py, and the buffers of its counters."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from backends.vulkan import api as vk
from backends.vulkan.resources import Buffer

from . import memory
from .renderer import Wavefront


class WaveMemory(memory.WaveMemory):
    """Buffers of the renderer's resources, which free them."""

    def _create_head(self, size: int) -> Buffer:
        usage = vk.VK_BUFFER_USAGE_STORAGE_BUFFER_BIT | vk.VK_BUFFER_USAGE_INDIRECT_BUFFER_BIT
        resources = self._backend.resources
        buffer: Buffer = resources.buffers.get(resources.buffer(size, usage, "device", "head of the wave"))
        return buffer

    def _create_told(self, size: int, name: str) -> Buffer:
        resources, usage = self._backend.resources, vk.VK_BUFFER_USAGE_STORAGE_BUFFER_BIT
        buffer: Buffer = resources.buffers.get(resources.buffer(size, usage, "readback", name))
        return buffer

    def _read(self, buffer: Buffer) -> NDArray[np.uint32]:
        assert buffer.allocation is not None, "the CPU reads it"
        self._backend.device.memory.invalidate(buffer.allocation)
        return buffer.view(np.uint32).copy()


class Renderer(Wavefront):
    """Paths by kernels over queues, on Vulkan."""
