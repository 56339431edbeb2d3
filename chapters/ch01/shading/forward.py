"""The forward pass: every object of the scene is drawn once and lit by all lights while it is drawn."""

from __future__ import annotations

from backends.contract import Access

from ..frames.commands import Commands, DrawGroup
from ..pipelines.description import PipelineDescription
from ..scene.data import SceneData
from ..scene.draw_lists import Batch
from ..scene.packing import Variant
from ..scene.pass_parts import PassParts
from ..settings import Settings
from . import views
from .objects import ObjectsPass
from .samples import coverage_defines
from .sky import Sky


def describe_lit(data: SceneData, settings: Settings, variant: Variant) -> PipelineDescription:
    """Return the pipeline that draws materials of `variant` with all lights."""
    return PipelineDescription(
        shaders=("shading/forward.vert", "shading/forward.frag"),
        defines=variant.defines + coverage_defines(variant, settings),
        sets=data.sets(variant),
        streams=data.vertex_streams(variant),
        color=settings.color_format,
        depth=views.depth_use(settings, variant),
        blend=views.blending(settings, variant),
        samples=settings.msaa,
        name=f"forward {' '.join(name.lower() for name, _ in variant.defines)}",
    )


class ForwardPass(ObjectsPass):
    """Opaque objects, then alpha-masked ones, the nearest first; then transparent ones from the farthest on.

    The barriers in front of it stand in `renderer.py` (`_to_forward`); the calls behind `draw_groups` stand in
    `frames/vulkan_commands.py`.
    """

    name = "forward"

    def __init__(self, parts: PassParts) -> None:
        super().__init__(parts)
        settings = parts.settings
        grey = views.background(settings, settings.background)
        samples = settings.msaa
        color, depth = "color_hdr" if samples == 1 else "color_msaa", views.depth_target(settings)
        clear = (grey, grey, grey, 1.0)
        self.writes = (
            Access(color, "color", format=settings.color_format, clear=clear, samples=samples),
            Access(depth, "depth", format="d32f", clear=(0.0,), samples=samples),
        )
        self._sky = Sky(parts) if Sky.needed(parts.scene, settings) else None
        self._transparent: tuple[list[Batch], list[DrawGroup]] = ([], [])  # groups, until the batches change

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
            self._sky.create()

    def record(self, commands: Commands) -> None:
        """Record the draws of this frame."""
        draws = self._draws
        commands.draw_groups(self.groups(draws.solid), draws.binding)
        if self._sky is not None:
            self._sky.record(commands)
        if draws.transparent:
            if self._transparent[0] is not draws.transparent:
                self._transparent = draws.transparent, self.groups(draws.transparent)
            groups = self._transparent[1]
            commands.draw_groups([groups[index] for index in draws.order], draws.binding)
