"""The transparent pass: what lets light through, over what the lighting pass has lit."""

from __future__ import annotations

from backends.contract import Access
from common.scene import Scene

from ..frames.commands import Commands
from ..pipelines.description import PipelineDescription
from ..scene.packing import Variant
from ..scene.pass_parts import PassParts
from ..settings import Settings
from ..transparency.model import layered
from .deferred import has_transparent
from .forward import describe_lit
from .objects import ObjectsPass


class TransparentPass(ObjectsPass):
    """Draws blended objects as the forward path does, farthest first, each one shaded while it is drawn.

    A G-buffer has room for one surface at each pixel, so what lies over another one has to bring its light with it.
    """

    name = "transparent"
    draws_solid, draws_blended = False, True

    def __init__(self, parts: PassParts) -> None:
        super().__init__(parts)
        self.reads = (Access("depth", "depth"),)
        self.writes = (
            Access("color_hdr", "color", format=parts.settings.shading.color_format, of="color_lit"),
        )
        if layered(parts.settings):  # another pass writes it
            self.writes = ()

    @staticmethod
    def needed(scene: Scene, settings: Settings) -> bool:
        """Whether any object is transparent; else what was lit is the picture."""
        return has_transparent(scene) and not layered(settings)

    def takes(self, variant: Variant) -> bool:
        """Whether light passes through."""
        return variant.alpha_mode == "blend"

    def describe(self, variant: Variant) -> PipelineDescription:
        """Return the forward pass's pipeline."""
        return describe_lit(self._data, self._settings, variant)

    def record(self, commands: Commands) -> None:
        """Record the draws of this frame."""
        commands.draw_groups(self.groups(self._draws.transparent), self._draws.transparent_binding)
