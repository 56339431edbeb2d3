"""The G-buffer pass: what the nearest surface is at each pixel, for the lighting pass to light it."""

from __future__ import annotations

from dataclasses import replace

from common.scene import Scene

from ..pipelines.description import PipelineDescription
from ..scene.packing import Variant
from ..scene.pass_parts import PassParts
from ..settings import Settings
from ..visibility.model import in_use
from . import deferred
from .forward import depth_accesses, describe_lit
from .objects import ObjectsPass


class GBufferPass(ObjectsPass):
    """The forward pass up to where light comes in: its solid draws, by the same shader, which stores the surface.

    The cost of a surface no longer depends on the number of lights, nor the cost of a light on the number of
    surfaces: with n of them behind a pixel and m lights, n + m in place of n x m. The price is memory, and that a pixel
    holds one surface, with one sample and nothing transparent before it.
    """

    name = "gbuffer"

    def __init__(self, parts: PassParts) -> None:
        super().__init__(parts)
        self.reads, depth = depth_accesses(parts.settings)
        *targets, self._emission = deferred.written(parts.settings)
        self.writes = (*targets, *depth)

    def declare(self) -> None:
        """Write the emission only while a material emits."""
        kept = [access for access in self.writes if not access.resource.startswith(deferred.EMISSION)]
        self.writes = (*kept, *[self._emission] * deferred.emits(self._scene, self._settings))

    def split(self, late: ObjectsPass) -> str:
        """Draw the early phase alone; see ObjectsPass. The emission is split like the other targets."""
        assert isinstance(late, GBufferPass), late
        early = f"{deferred.EMISSION}_early"
        self._emission = replace(self._emission, resource=early)
        late._emission = replace(late._emission, of=early, clear=None)
        return super().split(late)

    @staticmethod
    def needed(scene: Scene, settings: Settings) -> bool:
        """Even an empty scene has a background, where depth says that nothing was drawn."""
        return deferred.possible(settings) and not in_use(settings)

    def part_of(self, variant: Variant) -> Variant:
        """Return what says what a surface is."""
        return deferred.surface_alone(variant)

    def describe(self, variant: Variant) -> PipelineDescription:
        """Return the pipeline: the forward pass's, without light and with other targets."""
        surface = deferred.surface_alone(variant)
        textures = self._data.texture_defines(surface, deferred.surface_alone)
        return replace(
            describe_lit(self._data, self._settings, variant),
            defines=(
                *(*surface.defines, *textures, ("GBUFFER", 1), *deferred.code_defines(self._settings)),
                *deferred.emission_defines(self._scene, self._settings),
            ),
            color=deferred.formats(self._scene, self._settings),
            name=f"G-buffer {' '.join(name.lower() for name, _ in surface.defines)}",
        )
