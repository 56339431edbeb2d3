"""The pass of temporal anti-aliasing, behind everything that is lit and before the lens.

    color_hdr, depth, motion, history_color of the frame before -> taa -> history_color

The history is the picture: the passes behind it read it, and the next frame reads it as its history. The frame graph
swaps its two images, so nothing is copied.
"""

from __future__ import annotations

from backends.contract import Access, Pass
from common.scene import Scene

from ..frames.commands import Commands
from ..pipelines.compute_description import ComputeDescription
from ..scene.data import BEHIND_SCENE
from ..scene.pass_parts import PassParts
from ..settings import Settings
from . import model
from .scale import period

HISTORY = "history_color"

WEIGHTS = "history_weight"
"""Sums of the weights of samples in the history, for a picture with more pixels than are drawn."""


class TaaPass(Pass):
    """Blends the frame with the history, an invocation for each pixel."""

    name = "taa"
    sources = BEHIND_SCENE
    reads: tuple[Access, ...] = (
        Access("color_hdr", "sampled"),
        Access("depth", "sampled"),
        Access("motion", "sampled"),
        Access(HISTORY, "sampled", previous=True),
    )

    def __init__(self, parts: PassParts) -> None:
        self._settings, self._pipelines, self._draws = parts.settings, parts.pipelines, parts.draws
        format = parts.settings.taa.taa_format
        self.writes = (Access(HISTORY, "storage", format=format, instead="color_traced"),)
        if model.scale(parts.settings) < 1.0:
            self.reads = (*self.reads, Access(WEIGHTS, "sampled", previous=True))
            self.writes = (*self.writes, Access(WEIGHTS, "storage", format="r32f"))

    @staticmethod
    def needed(scene: Scene, settings: Settings) -> bool:
        """Whether the settings ask for it."""
        return model.in_use(settings)

    def create(self) -> None:
        """Build the pipeline."""
        more = model.scale_defines(self._settings, period(self._settings))
        defines = model.resolve_defines(self._settings) + more
        self.pipelines = self._pipelines.get(
            [ComputeDescription("taa/resolve.comp", defines, name=self.name)]
        )

    def record(self, commands: Commands) -> None:
        """Record the kernel over all pixels."""
        (pipeline,) = self.pipelines
        commands.bind_compute(pipeline, self._draws.binding)
        commands.dispatch_over(pipeline, commands.extent)
