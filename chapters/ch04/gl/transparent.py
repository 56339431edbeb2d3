"""The transparent pass: what lets light through, over what the lighting pass has lit."""

from __future__ import annotations

from backends.contract import Access
from common.scene import Scene

from ..logic import deferred
from ..settings import Settings
from .commands import Commands
from .gbuffer import GBufferPass
from .pipelines import Pipelines
from .scene_data import SceneData


class TransparentPass:
    """Draws blended objects as the forward path does, farthest first, each one shaded while it is drawn.

    A G-buffer has room for one surface at each pixel, so what lies over another one has to bring its light with it.
    """

    name = "transparent"

    def __init__(
        self, gbuffer: GBufferPass, settings: Settings, data: SceneData, pipelines: Pipelines
    ) -> None:
        self._gbuffer, self._data, self._pipelines = gbuffer, data, pipelines
        self.reads = (Access("depth", "depth"),)
        self.writes = (Access("color_hdr", "color", format=settings.color_format, of="color_lit"),)

    @staticmethod
    def needed(scene: Scene, settings: Settings) -> bool:
        """Whether any object is transparent; else what was lit is the picture."""
        return deferred.has_transparent(scene)

    def create(self) -> None:
        """Build the pipelines of what is transparent; again when a material became another kind."""
        kinds = deferred.kinds(self._data.variants, self._gbuffer.used, transparent=True)
        self._pipelines.get([self._gbuffer.describe(variant) for variant in kinds])

    def record(self, commands: Commands) -> None:
        """Make the draws of what is transparent."""
        records = self._data.slots[self._gbuffer.slot].commands
        commands.draw_groups(self._gbuffer.transparent, records)
