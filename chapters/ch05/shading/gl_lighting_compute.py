"""The lighting pass as compute: the same light, from invocations in place of the fragments of a triangle."""

from __future__ import annotations

from typing import Any, ClassVar

from backends.contract import Access

from ..frames.gl_commands import Commands
from ..pipelines.gl import Pipelines
from ..pipelines.gl_compute import ComputePipeline
from ..scene.gl_data import ARRAY_UNIT, SceneData
from ..settings import Settings
from .gl_forward import ForwardPass
from .gl_lighting import LightingPass


class ComputeLightingPass(LightingPass):
    """Lights each pixel by an invocation of its own, and stores the colour in the image that others draw over."""

    name = "lighting_compute"
    first_bindings: ClassVar = {"texture": ARRAY_UNIT, "storage": 4, "uniform": 1}
    """Behind those of the scene."""
    source: Any
    extent: tuple[int, int]
    """The pixels of what it writes; the executor says them."""

    def __init__(
        self, forward: ForwardPass, settings: Settings, data: SceneData, pipelines: Pipelines
    ) -> None:
        super().__init__(forward, settings, data, pipelines)
        self.writes = (Access("color_lit", "storage", format=settings.color_format),)

    def create(self) -> None:
        """Build the pipeline; again when a material became another kind."""
        defines = (*self.describe().defines, ("FORMAT", self._settings.color_format))
        self.pipeline = self._pipelines.get(
            [ComputePipeline("shading/lighting.comp", defines, name=self.name)]
        )[0]

    def record(self, commands: Commands) -> None:
        """Dispatch over all pixels."""
        commands.bind_compute(self.pipeline)
        commands.bind_sources(self.source)
        commands.dispatch_over(self.pipeline, self.extent)
