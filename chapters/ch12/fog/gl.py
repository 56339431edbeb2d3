"""The memory of fog on OpenGL; compare vulkan.py."""

from __future__ import annotations

import numpy as np

from backends.gl.resources import Buffer, create_buffer, destroy_buffer, write_buffer

from .memory import BLOCK
from .memory import FogMemory as _FogMemory


class FogMemory(_FogMemory):
    """Buffers that this object owns."""

    def _create_block(self, name: str) -> Buffer:
        return create_buffer(self._backend.device, BLOCK.itemsize, "upload", name)

    def _create_buffer(self, size: int, beginning: np.ndarray, name: str) -> Buffer:
        buffer = create_buffer(self._backend.device, size, "device", name)
        write_buffer(self._backend.device, buffer, beginning)
        return buffer

    def _free_store(self) -> None:
        if self.store is not None:
            destroy_buffer(self._backend.device, self.store)
        self.store = None

    def close(self) -> None:
        """Free everything."""
        super().close()
        for buffer in (*self.blocks, *([] if self.tables is None else [self.tables])):
            destroy_buffer(self._backend.device, buffer)
        self.blocks, self.tables = [], None
