"""Our BVH on OpenGL; compare vulkan.py."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from backends.gl.resources import Buffer, bind_buffer, create_buffer, destroy_buffer, write_buffer

from ...frames.commands import SceneBinding
from ...frames.gl_commands import PAGE_BINDING, Commands
from ...pipelines.description import Built
from ..passes import BUFFERS
from .memory import INSTANCES, NODES, TRIANGLES, BvhMemory

_TABLE = {TRIANGLES: "meshes", NODES: "list", INSTANCES: "slots"}


class Memory(BvhMemory):
    """Buffers that this object owns, bound to each kernel one by one."""

    def bind_pass(
        self, commands: Commands, pipeline: Built, scene: SceneBinding, page: Any, textures: Any
    ) -> None:
        """Bind a kernel, a page and a set of textures; the scene is bound for the whole frame."""
        commands.bind_compute(pipeline, scene)
        bind_buffer(self._backend.device, "storage", PAGE_BINDING, page[0])
        if textures is not None:
            commands.bind_textures(textures)

    def _create(self, content: NDArray[np.uint8], name: str) -> Buffer:
        buffer = create_buffer(self._backend.device, content.nbytes, "device", name)
        write_buffer(self._backend.device, buffer, content)
        return buffer

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
