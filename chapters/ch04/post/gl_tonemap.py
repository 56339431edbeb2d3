"""The tone-mapping pass: from linear light to the picture that a display shows."""

from __future__ import annotations

from backends.contract import Access
from common.scene import Scene

from ..frames.gl_commands import Commands, Textures
from ..pipelines.gl import GraphicsPipeline, Pipelines
from ..scene.gl_data import SceneData
from ..settings import Settings
from ..shading.views import tonemap_defines


class TonemapPass:
    """One triangle over the whole picture."""

    name = "tonemap"
    reads = (Access("color_hdr", "sampled"),)
    writes = (Access("color", "color", format="rgba8"),)

    def __init__(self, settings: Settings, data: SceneData, pipelines: Pipelines) -> None:
        self._settings, self._data, self._pipelines = settings, data, pipelines
        self.source: Textures = ()

    @staticmethod
    def needed(scene: Scene, settings: Settings) -> bool:
        """Every picture that is looked at needs it; without the output `color` the renderer leaves it out."""
        return True

    def create(self) -> None:
        """Build the pipeline."""
        self._pipeline = self._pipelines.get(
            [
                GraphicsPipeline(
                    shaders=("post/fullscreen.vert", "post/tonemap.frag"),
                    defines=tonemap_defines(self._settings),
                    depth=None,
                    name="tonemap",
                )
            ]
        )[0]

    def record(self, commands: Commands) -> None:
        """Draw the triangle."""
        commands.bind_pipeline(self._pipeline, cull=False, front="counter_clockwise")
        commands.bind_textures(self.source)
        commands.draw_fullscreen(self._data.empty_vertex_array)
