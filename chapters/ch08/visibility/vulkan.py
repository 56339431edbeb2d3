"""The draw of the resolve on Vulkan: four sets, and the constants."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..frames.backend.vulkan import VulkanBackend
from ..frames.vulkan_commands import Commands
from ..pipelines.description import Built
from ..scene.vulkan_data import FRAME, PAGE, TEXTURES


class Draws:
    """Records triangles over all pixels."""

    def __init__(self, backend: VulkanBackend) -> None:
        pass

    def draw(
        self, commands: Commands, pipeline: Built, scene: Any, page: Any, textures: Any, constants: np.ndarray
    ) -> None:
        """Record one triangle, by whichever thread records draws."""
        sources = commands.sources

        def record(commands: Commands) -> None:
            commands.bind_pipeline(pipeline)
            commands.bind_set(pipeline, FRAME, scene.frame)
            commands.bind_set(pipeline, PAGE, page[0])
            if textures is not None:
                commands.bind_set(pipeline, TEXTURES, textures)
            commands.bind_set(pipeline, *sources)
            commands.push(pipeline, constants)
            commands.draw_triangle()

        commands.draw_by(record)
