"""The G-buffer pass: what the nearest surface is at each pixel, for the lighting pass to light it."""

from __future__ import annotations

from dataclasses import replace

from common.scene import Scene

from ..graphics.commands import Commands
from ..graphics.pipelines import GraphicsPipeline, Pipelines
from ..graphics.scene_data import SceneData
from ..logic import deferred
from ..logic.packing import Variant
from ..settings import Settings
from .forward import ForwardPass


class GBufferPass(ForwardPass):
    """The forward pass up to where light comes in: its solid draws, by the same shader, which stores the surface.

    What a surface costs no longer depends on the number of lights, and what light costs no longer on the number of
    surfaces: with n of them behind a pixel and m lights, n + m in place of n x m. The price is memory, and that a pixel
    holds one surface, with one sample and nothing transparent before it.
    """

    name = "gbuffer"

    def __init__(self, scene: Scene, settings: Settings, data: SceneData, pipelines: Pipelines) -> None:
        super().__init__(scene, settings, data, pipelines)
        self.writes = (*deferred.written(settings), *self.writes[1:])
        self.sky = self._sky is not None
        """Whether there is a sky behind all surfaces, for the lighting pass to draw."""

    def describe(self, variant: Variant) -> GraphicsPipeline:
        """Return the pipeline that draws materials of `variant`; a transparent one is shaded as it is drawn."""
        described = super().describe(variant)
        if variant.alpha_mode == "blend":
            return described
        surface = deferred.surface_alone(variant)
        textures = self._data.texture_defines(surface, deferred.surface_alone)
        return replace(
            described,
            defines=(*surface.defines, *textures, ("GBUFFER", 1)),
            color=deferred.FORMATS[self._settings.gbuffer_format],
            name=f"G-buffer {' '.join(name.lower() for name, _ in surface.defines)}",
        )

    def create(self) -> None:
        """Build the pipelines of what is solid; again when a material became another kind."""
        solid = deferred.kinds(self._data.variants, self.used, transparent=False)
        self.built = self._pipelines.get([self.describe(variant) for variant in solid])
        self._draws.forget()
        self._groups.clear()

    def record(self, commands: Commands) -> None:
        """Record the draws of what is solid."""
        slot = self._data.slots[self.slot]
        commands.draw_groups(self.solid, self._data.frame_set(self.slot), slot.commands)
