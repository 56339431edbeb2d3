"""What full-screen passes have in common: one triangle, whose shader reads what other passes wrote."""

from __future__ import annotations

from backends.contract import Pass, Sources

from ..frames.commands import Commands
from ..pipelines.description import PipelineDescription
from ..scene.pass_parts import PassParts


class FullscreenPass(Pass):
    """A pass that draws one triangle over its whole target."""

    sources: Sources

    def __init__(self, parts: PassParts) -> None:
        self._settings, self._pipelines = parts.settings, parts.pipelines

    def describe(self) -> PipelineDescription:
        """Return the pipeline of the triangle."""
        raise NotImplementedError

    def create(self) -> None:
        """Build the pipeline."""
        self.pipelines = self._pipelines.get([self.describe()])

    def record(self, commands: Commands) -> None:
        """Record the triangle."""
        (pipeline,) = self.pipelines
        commands.draw_fullscreen(pipeline)
