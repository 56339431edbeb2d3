"""The tone-mapping pass: from linear light to the picture that a display shows."""

from __future__ import annotations

from typing import Any

from backends.contract import Access
from backends.vulkan import api as vk
from common.scene import Scene

from ..frames.vulkan_commands import Commands
from ..pipelines.vulkan import GraphicsPipeline, Pipelines
from ..settings import Settings
from ..shading.views import tonemap_defines


class TonemapPass:
    """One triangle over the whole picture."""

    name = "tonemap"
    reads = (Access("color_hdr", "sampled"),)
    writes = (Access("color", "color", format="rgba8"),)

    def __init__(self, settings: Settings, pipelines: Pipelines) -> None:
        self._settings, self._pipelines = settings, pipelines
        self.source_set: Any = None

    @staticmethod
    def needed(scene: Scene, settings: Settings) -> bool:
        """Every picture that is looked at needs it; without the output `color` the renderer leaves it out."""
        return True

    def create(self) -> None:
        """Build the pipeline."""
        self.pipeline = self._pipelines.get(
            [
                GraphicsPipeline(
                    shaders=("post/fullscreen.vert", "post/tonemap.frag"),
                    defines=tonemap_defines(self._settings),
                    color="rgba8",
                    depth=None,
                    name="tonemap",
                )
            ]
        )[0]

    def record(self, commands: Commands) -> None:
        """Record the triangle."""
        commands.bind_pipeline(self.pipeline, vk.VK_CULL_MODE_NONE, vk.VK_FRONT_FACE_COUNTER_CLOCKWISE)
        commands.bind_set(self.pipeline, 0, self.source_set)
        commands.draw_fullscreen()
