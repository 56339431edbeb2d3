"""The bindings of the resolve on Vulkan: four sets."""

from __future__ import annotations

from typing import Any

from ..frames.backend.vulkan import VulkanBackend
from ..frames.commands import SceneBinding
from ..frames.vulkan_commands import Commands
from ..pipelines.description import Built
from ..scene.vulkan_data import PAGE, TEXTURES


class Bindings:
    """Binds what the resolve reads."""

    def __init__(self, backend: VulkanBackend) -> None:
        pass

    def bind(
        self, commands: Commands, pipeline: Built, scene: SceneBinding, page: Any, textures: Any
    ) -> None:
        """Bind the kernel, the scene, the targets, a page and a set of textures."""
        commands.bind_compute(pipeline, scene)
        commands.bind_compute_set(pipeline, PAGE, page[0])
        if textures is not None:
            commands.bind_compute_set(pipeline, TEXTURES, textures)
