"""The lighting pass as compute: the same light, from invocations in place of the fragments of a triangle."""

from __future__ import annotations

from dataclasses import replace

from backends.contract import Access

from ..frames.vulkan_commands import Commands
from ..pipelines.vulkan import Pipelines
from ..pipelines.vulkan_compute import ComputePipeline
from ..scene.vulkan_data import COMPUTED, SceneData
from ..settings import Settings
from .vulkan_forward import ForwardPass
from .vulkan_lighting import LightingPass


class ComputeLightingPass(LightingPass):
    """Lights each pixel by an invocation of its own, and stores the colour in the image that others draw over."""

    name = "lighting_compute"
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
        described = ComputePipeline("shading/lighting.comp", defines, name=self.name)
        self.pipeline = self._pipelines.get([described])[0]
        frame = self.pipeline.sets[0]
        self.built = [replace(self.pipeline, sets=(*(None,) * COMPUTED, frame))]

    def record(self, commands: Commands) -> None:
        """Record a dispatch over all pixels."""
        pipeline = self.pipeline
        commands.bind_compute(pipeline)
        commands.bind_compute_set(pipeline, 0, self._data.computed_set(self._forward.slot))
        commands.bind_compute_set(pipeline, self.source_number, self.source_set)
        commands.dispatch_over(pipeline, self.extent)
