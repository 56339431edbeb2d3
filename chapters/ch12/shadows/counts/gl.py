"""The counters of casters on OpenGL; compare vulkan.py."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from backends.gl import api as gl
from backends.gl.resources import Buffer, bind_buffer, create_buffer, destroy_buffer

from ...frames.frame import SLOTS
from .model import WORDS
from .model import ShadowCounts as _ShadowCounts

TOLD_BINDING = 11
"""The storage block of the counters, behind those of cull.glsl."""


class ShadowCounts(_ShadowCounts):
    """A mapped buffer for each slot."""

    def _create(self) -> None:
        self._buffers: list[Buffer] = [
            create_buffer(self._backend.device, 4 * WORDS, "readback", f"shadow counters, slot {slot}")
            for slot in range(SLOTS)
        ]

    def _read(self, slot: int) -> NDArray[np.uint32]:
        counters: NDArray[np.uint32] = self._buffers[slot].view(np.uint32).copy()
        return counters[:WORDS]

    def _bind(self, commands: Any, memory: Any) -> None:
        memory.bind_lists(commands, self._kernel)
        bind_buffer(self._backend.device, "storage", TOLD_BINDING, self._buffers[commands.slot.index])

    def finish(self, commands: Any) -> None:
        """Make the counters visible to the CPU."""
        self._backend.device.fn.glMemoryBarrier(gl.GL_CLIENT_MAPPED_BUFFER_BARRIER_BIT)

    def close(self) -> None:
        """Free the buffers; OpenGL itself waits for their last use."""
        for buffer in self._buffers:
            destroy_buffer(self._backend.device, buffer)
        self._buffers = []
