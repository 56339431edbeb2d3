"""The lighting pass: every pixel's surface out of the G-buffer, lit by all lights."""

from __future__ import annotations

from backends.contract import Access
from common.scene import Scene

from ..logic.deferred import TARGETS, light_defines
from ..settings import Settings
from .commands import Commands, Textures
from .gbuffer import GBufferPass
from .pipelines import GraphicsPipeline, Pipelines
from .scene_data import ARRAY_UNIT, SceneData
from .sky import Sky


class LightingPass:
    """One triangle over the whole picture; where nothing was drawn it shows the sky, or the background's grey.

    The environment's maps stay bound to the first units, so what it reads of other passes is behind them.
    """

    name = "lighting"

    def __init__(
        self, scene: Scene, gbuffer: GBufferPass, settings: Settings, data: SceneData, pipelines: Pipelines
    ) -> None:
        self._scene, self._gbuffer, self._settings = scene, gbuffer, settings
        self._data, self._pipelines = data, pipelines
        self.reads = tuple(Access(name, "sampled") for name in (*TARGETS, "depth"))
        self.writes = (Access("color_lit", "color", format=settings.color_format),)
        self.source: Textures = ()

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
            depth=None,
            name="lighting",
        )
        self._pipeline = self._pipelines.get([described])[0]

    def record(self, commands: Commands) -> None:
        """Draw the triangle."""
        commands.bind_pipeline(self._pipeline, cull=False, front="counter_clockwise")
        commands.bind_textures(
            tuple((ARRAY_UNIT + unit, view, sampler) for unit, view, sampler in self.source)
        )
        commands.draw_fullscreen(self._data.empty_vertex_array)
