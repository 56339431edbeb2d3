"""The lighting pass: every pixel's surface out of the G-buffer, lit by all lights."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from backends.contract import Access
from backends.vulkan import api as vk
from common.scene import Scene

from ..graphics.commands import Commands
from ..graphics.pipelines import Built, GraphicsPipeline, Pipelines
from ..graphics.scene_data import SceneData
from ..logic.deferred import TARGETS, light_defines
from ..settings import Settings
from .gbuffer import GBufferPass
from .sky import Sky


class LightingPass:
    """One triangle over the whole picture; where nothing was drawn it shows the sky, or the background's grey.

    Set 0 is the frame's. What it reads of other passes is set `source_number`.
    """

    name = "lighting"
    source_number = 1

    def __init__(
        self, scene: Scene, gbuffer: GBufferPass, settings: Settings, data: SceneData, pipelines: Pipelines
    ) -> None:
        self._scene, self._gbuffer, self._settings = scene, gbuffer, settings
        self._data, self._pipelines = data, pipelines
        self.reads = tuple(Access(name, "sampled") for name in (*TARGETS, "depth"))
        self.writes = (Access("color_lit", "color", format=settings.color_format),)
        self.source_set: Any = None
        self.built: list[Built] = []

    @staticmethod
    def needed(scene: Scene, settings: Settings) -> bool:
        """Even an empty scene has a background."""
        return True

    def create(self) -> None:
        """Build the pipeline; again when another kind of material takes part."""
        variants = [self._data.variants[material] for material in self._gbuffer.used]
        sky = Sky.needed(self._scene, self._settings)
        described = GraphicsPipeline(
            shaders=("fullscreen.vert", "lighting.frag"),
            defines=light_defines(variants, sky, self._settings),
            color=self._settings.color_format,
            depth=None,
            name="lighting",
        )
        self.pipeline = self._pipelines.get([described])[0]
        self.built = [
            replace(self.pipeline, sets=self.pipeline.sets[:1])
        ]  # what it shares with the scene's draws

    def record(self, commands: Commands) -> None:
        """Record the triangle."""
        commands.bind_pipeline(self.pipeline, vk.VK_CULL_MODE_NONE, vk.VK_FRONT_FACE_COUNTER_CLOCKWISE)
        commands.bind_set(self.pipeline, 0, self._data.frame_set(self._gbuffer.slot))
        commands.bind_set(self.pipeline, self.source_number, self.source_set)
        commands.draw_fullscreen()
