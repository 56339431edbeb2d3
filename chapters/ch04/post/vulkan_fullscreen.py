"""What full-screen passes have in common: one triangle, whose shader reads what other passes wrote."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from backends.contract import Access
from backends.vulkan import api as vk

from ..frames.vulkan_commands import Commands
from ..pipelines.vulkan import Built, GraphicsPipeline, Pipelines
from ..scene.vulkan_data import SceneData
from ..settings import Settings
from ..shading.vulkan_forward import ForwardPass


class FullscreenPass:
    """A pass that draws one triangle over its whole targets.

    Its sources are set `source_number`, binding i being the i-th image that it reads as "sampled". With number 1, set 0
    is that of the scene, which holds the frame's constants, lights and environment.
    """

    name: str
    reads: tuple[Access, ...]
    writes: tuple[Access, ...]
    source_number = 1

    def __init__(
        self, forward: ForwardPass, settings: Settings, data: SceneData, pipelines: Pipelines
    ) -> None:
        self._forward, self._settings = forward, settings
        self._data, self._pipelines = data, pipelines
        self.source_set: Any = None
        self.built: list[Built] = []
        """The pipeline with the sets that it shares with those of the scene."""

    def describe(self) -> GraphicsPipeline:
        """Return the pipeline of the triangle."""
        raise NotImplementedError

    def create(self) -> None:
        """Build the pipeline; again when a material became another kind."""
        self.pipeline = self._pipelines.get([self.describe()])[0]
        if self.source_number:
            self.built = [replace(self.pipeline, sets=self.pipeline.sets[:1])]

    def record(self, commands: Commands) -> None:
        """Record the triangle."""
        commands.bind_pipeline(self.pipeline, vk.VK_CULL_MODE_NONE, vk.VK_FRONT_FACE_COUNTER_CLOCKWISE)
        if self.source_number:
            commands.bind_set(self.pipeline, 0, self._data.frame_set(self._forward.slot))
        commands.bind_set(self.pipeline, self.source_number, self.source_set)
        commands.draw_fullscreen()
