"""The memory of paths on OpenGL; compare vulkan.py."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from backends.gl import api as gl
from backends.gl.resources import Buffer, create_buffer, destroy_buffer, write_buffer

from .memory import PathMemory as _PathMemory


class PathMemory(_PathMemory):
    """Buffers that this object owns."""

    def _create_block(self, size: int, name: str) -> Buffer:
        return create_buffer(self._backend.device, size, "upload", name)

    def _create_tables(self, words: NDArray[np.uint32]) -> Buffer:
        buffer = create_buffer(self._backend.device, words.nbytes, "device", "tables of paths")
        self._write_tables(buffer, words)
        return buffer

    def _create_told(self, size: int, name: str) -> Buffer:
        return create_buffer(self._backend.device, size, "readback", name)

    def _read(self, buffer: Buffer) -> NDArray[np.float32]:
        return buffer.view(np.float32).copy()

    def finish(self) -> None:
        """Make what shaders stored visible to the CPU."""
        self._backend.device.fn.glMemoryBarrier(gl.GL_CLIENT_MAPPED_BUFFER_BARRIER_BIT)

    def _write_tables(self, buffer: Buffer, words: NDArray[np.uint32]) -> None:
        write_buffer(self._backend.device, buffer, words)

    def close(self) -> None:
        """Free everything."""
        for buffer in (*self.blocks, *self._told, self.tables):
            destroy_buffer(self._backend.device, buffer)
        self.blocks, self._told = [], []
