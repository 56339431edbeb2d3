"""The lighting pass as compute: the same light, from invocations in place of the fragments of a triangle."""

from __future__ import annotations

from backends.contract import Access

from ..frames.commands import Commands
from ..pipelines.compute_description import ComputeDescription
from ..rates import passes as rates
from ..rates.model import AREA, coarse_define, texel_of
from ..scene.pass_parts import PassParts
from .lighting import LightingPass


class ComputeLightingPass(LightingPass):
    """Lights each pixel by an invocation of its own, and stores the colour in the image that others draw over."""

    name = "lighting_compute"

    def __init__(self, parts: PassParts) -> None:
        super().__init__(parts)
        self.writes = (Access("color_lit", "storage", format=parts.settings.shading.color_format),)
        self._rates = rates.read(parts.settings)
        self.reads = (*self.reads, *self._rates)

    def create(self) -> None:
        """Build the pipeline; again when a material became another kind."""
        sampled = [access for access in self.reads if access.use == "sampled"]  # they are bound first
        bound = ("LIT_BINDING", len(sampled))
        texel = ("RATE_TEXEL", texel_of(self._settings)), ("RATE_AREA", AREA), coarse_define(self._settings)
        by_rate = (("RATE_BINDING", len(sampled) - 1), *texel) if self._rates else ()
        defines = (*self.describe().defines, ("FORMAT", self._settings.shading.color_format), bound, *by_rate)
        described = ComputeDescription("shading/lighting.comp", defines, name=self.name)
        self.pipelines = self._pipelines.get([described])

    def record(self, commands: Commands) -> None:
        """Record a dispatch over all pixels; with rates a work group for each area of the picture."""
        (pipeline,) = self.pipelines
        commands.bind_compute(pipeline, self._draws.binding)
        if self._rates:
            commands.dispatch(*(-(-side // AREA) for side in commands.extent))
        else:
            commands.dispatch_over(pipeline, commands.extent)
