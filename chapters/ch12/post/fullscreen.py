"""What full-screen passes have in common: one triangle, whose shader reads what other passes wrote."""

from __future__ import annotations

from backends.contract import Pass, Sources

from ..frames.commands import Commands
from ..pipelines.description import PipelineDescription
from ..scene.data import BEHIND_SCENE
from ..scene.pass_parts import PassParts


class FullscreenPass(Pass):
    """A pass that draws one triangle over its whole targets.

    Its sources are the images that it reads as "sampled", in the order of `reads`. By default they are set 1, and set 0
    is that of the scene, which holds the frame's constants, lights and environment. A pass that needs nothing of the
    scene says `sources = Sources()`, and its sources are set 0.
    """

    sources: Sources = BEHIND_SCENE

    def __init__(self, parts: PassParts) -> None:
        self._settings, self._data = parts.settings, parts.data
        self._draws, self._pipelines = parts.draws, parts.pipelines

    def describe(self) -> PipelineDescription:
        """Return the pipeline of the triangle."""
        raise NotImplementedError

    def create(self) -> None:
        """Build the pipeline; again when a material became another kind."""
        self.pipelines = self._pipelines.get([self.describe()])

    def record(self, commands: Commands) -> None:
        """Record the triangle."""
        (pipeline,) = self.pipelines
        commands.draw_fullscreen(pipeline, self._draws.binding if self.sources.set else None)
