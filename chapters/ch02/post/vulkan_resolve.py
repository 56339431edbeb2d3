"""The resolve pass: from several samples of light in each pixel to one colour."""

from __future__ import annotations

from typing import Any

from backends.contract import Access
from backends.vulkan import api as vk
from common.scene import Scene

from ..frames.vulkan_commands import Commands
from ..pipelines.vulkan import GraphicsPipeline, Pipelines
from ..settings import Settings
from ..shading.samples import resolve_defines


class ResolvePass:
    """One triangle over the whole picture.

    The hardware resolves too, on its way out of the tile or in a copy, but only to the plain mean, and each driver adds
    in an order of its own.
    """

    name = "resolve"

    def __init__(self, settings: Settings, pipelines: Pipelines) -> None:
        self._settings, self._pipelines = settings, pipelines
        self.reads = (Access("color_msaa", "sampled", samples=settings.msaa),)
        self.writes = (Access("color_hdr", "color", format=settings.color_format),)
        self.source_set: Any = None

    @staticmethod
    def needed(scene: Scene, settings: Settings) -> bool:
        """Without further samples the forward pass draws what this pass would write."""
        return settings.msaa > 1

    def create(self) -> None:
        """Build the pipeline."""
        self.pipeline = self._pipelines.get(
            [
                GraphicsPipeline(
                    shaders=("post/fullscreen.vert", "post/resolve.frag"),
                    defines=resolve_defines(self._settings),
                    color=self._settings.color_format,
                    depth=None,
                    name="resolve",
                )
            ]
        )[0]

    def record(self, commands: Commands) -> None:
        """Record the triangle."""
        commands.bind_pipeline(self.pipeline, vk.VK_CULL_MODE_NONE, vk.VK_FRONT_FACE_COUNTER_CLOCKWISE)
        commands.bind_set(self.pipeline, 0, self.source_set)
        commands.draw_fullscreen()
