"""The buffers of our BVH on Vulkan."""

from __future__ import annotations

from typing import Any

import numpy as np

from backends.vulkan import api as vk
from backends.vulkan.resources import Buffer
from backends.vulkan.upload import Uploader

from ...frames.commands import SceneBinding
from ...frames.vulkan_commands import Commands
from ...pipelines.description import Built
from ...scene.vulkan_data import PAGE, TEXTURES
from .memory import BvhMemory

_STORED = (
    vk.VK_BUFFER_USAGE_STORAGE_BUFFER_BIT
    | vk.VK_BUFFER_USAGE_TRANSFER_DST_BIT
    | vk.VK_BUFFER_USAGE_TRANSFER_SRC_BIT
)


class Memory(BvhMemory):
    """Buffers of the renderer's resources, which free them."""

    def bind_pass(self, commands: Commands, pipeline: Built, scene: SceneBinding, page: Any, textures: Any) -> None:
        """Bind a kernel, the scene, a page and a set of textures."""
        commands.bind_compute(pipeline, scene)
        commands.bind_compute_set(pipeline, PAGE, page[0])
        if textures is not None:
            commands.bind_compute_set(pipeline, TEXTURES, textures)

    def _create(self, content: np.ndarray, name: str) -> Buffer:
        resources = self._backend.resources
        buffer: Buffer = resources.buffers.get(resources.buffer(content.nbytes, _STORED, "device", name))
        with Uploader(self._backend.device) as uploader:
            uploader.buffer(buffer, content)
        return buffer


open_structures = Memory
