"""The buffers of our BVH on OpenGL; compare vulkan.py."""

from __future__ import annotations

from typing import Any

import numpy as np

from backends.gl.resources import Buffer, bind_buffer, create_buffer, destroy_buffer, write_buffer

from ...frames.commands import SceneBinding
from ...frames.gl_commands import PAGE_BINDING, Commands
from ...pipelines.description import Built
from .memory import BvhMemory


class Memory(BvhMemory):
    """Buffers that this object owns."""

    def bind_pass(self, commands: Commands, pipeline: Built, scene: SceneBinding, page: Any, textures: Any) -> None:
        """Bind a kernel, a page and a set of textures; the scene is bound for the whole frame."""
        commands.bind_compute(pipeline, scene)
        bind_buffer(self._backend.device, "storage", PAGE_BINDING, page[0])
        if textures is not None:
            commands.bind_textures(textures)

    def _create(self, content: np.ndarray, name: str) -> Buffer:
        buffer = create_buffer(self._backend.device, content.nbytes, "device", name)
        write_buffer(self._backend.device, buffer, content)
        return buffer

    def close(self) -> None:
        """Free everything."""
        for buffer in self.buffers.values():
            destroy_buffer(self._backend.device, buffer)
        self.buffers = {}


open_structures = Memory
