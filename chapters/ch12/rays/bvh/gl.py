"""Our BVH on OpenGL; compare vulkan.py."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from backends.gl import api as gl
from backends.gl.resources import Buffer, bind_buffer, create_buffer, destroy_buffer, write_buffer

from ...frames.frame import SLOTS
from ...frames.gl_commands import Commands
from ...pipelines.description import Built
from ...visibility.gl import Bindings
from .kernels import PAGE, PLACES, TOLD
from .memory import BvhMemory


class Memory(BvhMemory):
    """Buffers that this object owns, bound to each kernel one by one."""

    surfaces = Bindings

    def _create(self, content: Mapping[str, NDArray[np.uint8]]) -> dict[str, Buffer]:
        buffers, context = {}, self._backend.device
        for name, part in content.items():
            buffers[name] = create_buffer(context, part.nbytes, "device", f"rays: {name}")
            write_buffer(context, buffers[name], part)
        return buffers

    def _replace(self, content: Mapping[str, NDArray[np.uint8]]) -> None:
        for name, part in content.items():
            if self.buffers[name].size >= part.nbytes:
                write_buffer(self._backend.device, self.buffers[name], part)

    def _bind_kernel(self, commands: Commands, kernel: str, pipeline: Built, slot: int, page: int) -> None:
        context, data = self._backend.device, self._data
        commands.bind_compute(pipeline)
        names = self._bound[kernel]
        for binding, name in enumerate(names):
            if name in self.buffers:
                bind_buffer(context, "storage", binding, self.buffers[name])
            elif name == TOLD:
                bind_buffer(context, "storage", binding, self.told[slot])
            elif name == PAGE:
                bind_buffer(context, "storage", binding, data.page_buffer(slot, page))
            elif name == PLACES:
                ends = (binding, len(names) - 1)
                for at, (offset, size) in zip(ends, data.instance_parts, strict=False):
                    bind_buffer(context, "storage", at, data.slots[slot].instances, offset, size)

    def _create_told(self, count: int) -> list[Buffer]:
        context = self._backend.device
        return [
            create_buffer(context, 4 * count, "readback", f"rays: costs, slot {slot}")
            for slot in range(SLOTS)
        ]

    def _read_told(self, slot: int) -> NDArray[np.float32]:
        costs: NDArray[np.float32] = self.told[slot].view(np.float32)[: len(self._trees)]
        return costs

    def _finish_told(self, commands: Commands) -> None:
        self._backend.device.fn.glMemoryBarrier(gl.GL_CLIENT_MAPPED_BUFFER_BARRIER_BIT)

    def _end(self, slot: int) -> None:
        self._data.bind_frame(slot)

    def close(self) -> None:
        """Free everything."""
        for buffer in (*self.buffers.values(), *self.told):
            destroy_buffer(self._backend.device, buffer)
        self.buffers, self.told = {}, []


open_structures = Memory
