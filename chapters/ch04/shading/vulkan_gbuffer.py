"""The G-buffer pass: what the nearest surface is at each pixel, for the lighting pass to light it."""

from __future__ import annotations

from dataclasses import replace

from common.scene import Scene

from ..pipelines.vulkan import GraphicsPipeline, Pipelines
from ..scene.packing import Variant
from ..scene.vulkan_data import SceneData
from ..settings import Settings
from . import deferred
from .vulkan_forward import ForwardPass
from .vulkan_objects import ObjectsPass


class GBufferPass(ObjectsPass):
    """The forward pass up to where light comes in: its solid draws, by the same shader, which stores the surface.

    What a surface costs no longer depends on the number of lights, and what light costs no longer on the number of
    surfaces: with n of them behind a pixel and m lights, n + m in place of n x m. The price is memory, and that a pixel
    holds one surface, with one sample and nothing transparent before it.
    """

    name = "gbuffer"

    def __init__(
        self, forward: ForwardPass, settings: Settings, data: SceneData, pipelines: Pipelines
    ) -> None:
        super().__init__(forward, settings, data, pipelines)
        self.reads = forward.reads
        self.writes = (*deferred.written(settings), *forward.writes[1:])  # and depth, if nobody has before

    @staticmethod
    def needed(scene: Scene, settings: Settings) -> bool:
        """Even an empty scene has a background, where depth says that nothing was drawn."""
        return deferred.possible(settings)

    def part_of(self, variant: Variant) -> Variant:
        """Return what says what a surface is."""
        return deferred.surface_alone(variant)

    def describe(self, variant: Variant) -> GraphicsPipeline:
        """Return the pipeline: the forward pass's, without light and with other targets."""
        surface = deferred.surface_alone(variant)
        textures = self._data.texture_defines(surface, deferred.surface_alone)
        return replace(
            self._forward.describe(variant),
            defines=(*surface.defines, *textures, ("GBUFFER", 1), *deferred.normal_defines(self._settings)),
            color=deferred.FORMATS[self._settings.gbuffer_format],
            name=f"G-buffer {' '.join(name.lower() for name, _ in surface.defines)}",
        )
