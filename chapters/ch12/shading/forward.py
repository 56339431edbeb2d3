"""The forward pass: every object of the scene is drawn once and lit by all lights while it is drawn."""

from __future__ import annotations

from backends.contract import Access

from ..frames.commands import Commands
from ..pipelines.description import PipelineDescription
from ..scene.data import SceneData
from ..scene.packing import Variant
from ..scene.pass_parts import PassParts
from ..settings import Settings
from ..transparency.model import layered
from . import views
from .objects import ObjectsPass
from .prepass import has_prepass
from .samples import coverage_defines
from .sky import Sky


def depth_accesses(settings: Settings) -> tuple[tuple[Access, ...], tuple[Access, ...]]:
    """Return how a pass reads and writes the depth of solid objects: behind a pre-pass it is only compared with."""
    samples, depth = settings.shading.msaa, views.depth_target(settings)
    if has_prepass(settings):
        return (Access(depth, "depth", samples=samples),), ()
    return (), (Access(depth, "depth", format="d32f", clear=(0.0,), samples=samples),)


def describe_lit(data: SceneData, settings: Settings, variant: Variant) -> PipelineDescription:
    """Return the pipeline that draws materials of `variant` with all lights."""
    return PipelineDescription(
        shaders=("shading/forward.vert", "shading/forward.frag"),
        defines=(
            *variant.defines,
            *data.texture_defines(variant),
            *coverage_defines(variant, settings),
        ),
        color=settings.shading.color_format,
        depth=views.depth_use(settings, variant),
        blend=views.blending(settings, variant),
        samples=settings.shading.msaa,
        name=f"forward {' '.join(name.lower() for name, _ in variant.defines)}",
    )


class ForwardPass(ObjectsPass):
    """Opaque objects, then alpha-masked ones, in the order of the scene; then transparent ones from the farthest on.

    The calls behind `draw_groups` stand in `frames/vulkan_commands.py`.
    """

    name = "forward"

    def __init__(self, parts: PassParts) -> None:
        super().__init__(parts)
        settings = parts.settings
        grey = views.background(settings, settings.shading.background)
        samples = settings.shading.msaa
        color, clear = "color_hdr" if samples == 1 else "color_msaa", (grey, grey, grey, 1.0)
        if layered(settings):  # layers are composited over it
            color = "color_lit"
        self.reads, written = depth_accesses(settings)
        self.writes = (
            Access(color, "color", format=settings.shading.color_format, clear=clear, samples=samples),
            *written,
        )
        self._sky = Sky(parts) if Sky.drawn(parts.scene, settings) else None
        self.draws_blended = True  # and the sky: both come after all solid objects

    def split(self, late: ObjectsPass) -> str:
        """Leave what comes after the solid objects to the late pass."""
        self.draws_blended = False
        return super().split(late)

    def takes(self, variant: Variant) -> bool:
        """Every material is drawn here."""
        return True

    def describe(self, variant: Variant) -> PipelineDescription:
        """Return the pipeline that draws materials of `variant`."""
        return describe_lit(self._data, self._settings, variant)

    def create(self) -> None:
        """Build the pipelines of all materials that are drawn, and that of the sky."""
        super().create()
        if self._sky is not None:
            self.pipelines = (*self.pipelines, self._sky.create())

    def record(self, commands: Commands) -> None:
        """Record the draws of this frame."""
        draws = self._draws
        self.record_solid(commands)
        if self._sky is not None and self.draws_blended:
            self._sky.record(commands)
        if self.draws_blended and not layered(self._settings):
            commands.draw_groups(self.groups(draws.transparent), draws.transparent_binding)
