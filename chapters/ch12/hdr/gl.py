"""The buffers of the exposure on OpenGL; compare vulkan.py."""

from __future__ import annotations

import numpy as np

from backends.gl import api as gl
from backends.gl.resources import Buffer, MemoryUse, create_buffer, destroy_buffer, write_buffer

from .memory import ExposureMemory as _ExposureMemory


class ExposureMemory(_ExposureMemory):
    """Buffers that this object owns."""

    _buffers: list[Buffer]

    def _create(self, size: int, use: MemoryUse, name: str) -> Buffer:
        buffer = create_buffer(self._backend.device, size, use, name)
        self.__dict__.setdefault("_buffers", []).append(buffer)
        return buffer

    def _clear(self, buffer: Buffer) -> None:
        write_buffer(self._backend.device, buffer, np.zeros(buffer.size // 4, np.uint32))

    def _read(self, buffer: Buffer) -> np.ndarray:
        return buffer.view(np.float32).copy()

    def finish(self) -> None:
        """Set a barrier: the graph knows no uniform blocks of the scene, and no memory of the CPU."""
        bits = gl.GL_UNIFORM_BARRIER_BIT | gl.GL_CLIENT_MAPPED_BUFFER_BARRIER_BIT
        self._backend.device.fn.glMemoryBarrier(bits)

    def close(self) -> None:
        """Free the buffers."""
        for buffer in self._buffers:
            destroy_buffer(self._backend.device, buffer)
        self._buffers = []
