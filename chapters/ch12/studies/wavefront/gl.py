"""The study wavefront on OpenGL: the frame of renderer.py, and the buffers of its counters."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from backends.gl.resources import Buffer, create_buffer, destroy_buffer

from . import memory
from .renderer import Wavefront


class WaveMemory(memory.WaveMemory):
    """Buffers that this object owns."""

    def _create_head(self, size: int) -> Buffer:
        return create_buffer(self._backend.device, size, "device", "head of the wave")

    def _create_told(self, size: int, name: str) -> Buffer:
        return create_buffer(self._backend.device, size, "readback", name)

    def _read(self, buffer: Buffer) -> NDArray[np.uint32]:
        return buffer.view(np.uint32).copy()

    def close(self) -> None:
        """Free everything."""
        for buffer in (self.head, *self._told):
            destroy_buffer(self._backend.device, buffer)


class Renderer(Wavefront):
    """Paths by kernels over queues, on OpenGL."""

    API = "gl"
