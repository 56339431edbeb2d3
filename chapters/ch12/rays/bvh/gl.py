"""Our BVH on OpenGL; compare vulkan.py."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from backends.gl.resources import Buffer, bind_buffer, create_buffer, destroy_buffer, write_buffer

from ...frames.gl_commands import Commands
from ...pipelines.description import Built
from ...visibility.gl import Bindings
from ..passes import BUFFERS
from .memory import INSTANCES, NODES, TRIANGLES, BvhMemory

_TABLE = {TRIANGLES: "meshes", NODES: "list", INSTANCES: "slots"}


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
        for binding, name in enumerate(BUFFERS):
            bind_buffer(context, "storage", binding, self.buffers[name])
        if kernel == INSTANCES:
            bind_buffer(context, "storage", 4, self.buffers["slots"])
            for binding, (offset, size) in zip((3, 5), data.instance_parts, strict=False):
                bind_buffer(context, "storage", binding, data.slots[slot].instances, offset, size)
            return
        bind_buffer(context, "storage", 3, self.buffers[_TABLE[kernel]])
        if kernel == TRIANGLES:
            bind_buffer(context, "storage", 4, data.page_buffer(slot, page))

    def _end(self, slot: int) -> None:
        self._data.bind_frame(slot)

    def close(self) -> None:
        """Free everything."""
        for buffer in self.buffers.values():
            destroy_buffer(self._backend.device, buffer)
        self.buffers = {}


open_structures = Memory
