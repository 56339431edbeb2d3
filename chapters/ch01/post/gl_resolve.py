"""The resolve pass: from several samples of light in each pixel to one colour."""

from __future__ import annotations

from backends.contract import Access
from common.scene import Scene

from ..frames.gl_commands import Commands, Textures
from ..pipelines.gl import GraphicsPipeline, Pipelines
from ..scene.gl_data import SceneData
from ..settings import Settings
from ..shading.samples import resolve_defines


class ResolvePass:
    """One triangle over the whole picture; a blit would resolve to the plain mean, in each driver's own order."""

    name = "resolve"

    def __init__(self, settings: Settings, data: SceneData, pipelines: Pipelines) -> None:
        self._settings, self._data, self._pipelines = settings, data, pipelines
        self.reads = (Access("color_msaa", "sampled", samples=settings.msaa),)
        self.writes = (Access("color_hdr", "color", format=settings.color_format),)
        self.source: Textures = ()

    @staticmethod
    def needed(scene: Scene, settings: Settings) -> bool:
        """Without further samples the forward pass draws what this pass would write."""
        return settings.msaa > 1

    def create(self) -> None:
        """Build the pipeline."""
        self._pipeline = self._pipelines.get(
            [
                GraphicsPipeline(
                    shaders=("post/fullscreen.vert", "post/resolve.frag"),
                    defines=resolve_defines(self._settings),
                    depth=None,
                    name="resolve",
                )
            ]
        )[0]

    def record(self, commands: Commands) -> None:
        """Draw the triangle."""
        commands.bind_pipeline(self._pipeline, cull=False, front="counter_clockwise")
        commands.bind_textures(self.source)
        commands.draw_fullscreen(self._data.empty_vertex_array)
