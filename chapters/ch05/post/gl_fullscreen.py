"""What full-screen passes have in common: one triangle, whose shader reads what other passes wrote."""

from __future__ import annotations

from backends.contract import Access

from ..frames.gl_commands import Commands, Textures
from ..pipelines.gl import GraphicsPipeline, Pipelines
from ..scene.gl_data import ARRAY_UNIT, SceneData
from ..settings import Settings
from ..shading.gl_forward import ForwardPass


class FullscreenPass:
    """A pass that draws one triangle over its whole targets.

    Its sources are (i, view, sampler), the i-th image that it reads as "sampled". The environment's maps stay bound to
    the first units for all passes that light something, so sources are bound behind them.
    """

    name: str
    reads: tuple[Access, ...]
    writes: tuple[Access, ...]

    def __init__(
        self, forward: ForwardPass, settings: Settings, data: SceneData, pipelines: Pipelines
    ) -> None:
        self._forward, self._settings = forward, settings
        self._data, self._pipelines = data, pipelines
        self.source: Textures = ()

    def describe(self) -> GraphicsPipeline:
        """Return the pipeline of the triangle."""
        raise NotImplementedError

    def create(self) -> None:
        """Build the pipeline; again when a material became another kind."""
        self.pipeline = self._pipelines.get([self.describe()])[0]

    def record(self, commands: Commands) -> None:
        """Draw the triangle."""
        commands.bind_pipeline(self.pipeline, cull=False, front="counter_clockwise")
        commands.bind_textures(
            tuple((ARRAY_UNIT + unit, view, sampler) for unit, view, sampler in self.source)
        )
        commands.draw_fullscreen(self._data.empty_vertex_array)
