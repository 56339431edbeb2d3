"""The resolve pass: from several samples of light in each pixel to one colour."""

from __future__ import annotations

from backends.contract import Access, Sources
from common.scene import Scene

from ..pipelines.description import PipelineDescription
from ..scene.pass_parts import PassParts
from ..settings import Settings
from ..shading.samples import resolve_defines
from .fullscreen import FullscreenPass


class ResolvePass(FullscreenPass):
    """One triangle over the whole picture.

    The hardware can resolve too, but only to the plain mean, and each driver adds in an order of its own.
    """

    name = "resolve"
    sources = Sources()

    def __init__(self, parts: PassParts) -> None:
        super().__init__(parts)
        settings = parts.settings
        self.reads = (Access("color_msaa", "sampled", samples=settings.shading.msaa),)
        self.writes = (Access("color_hdr", "color", format=settings.shading.color_format),)

    @staticmethod
    def needed(scene: Scene, settings: Settings) -> bool:
        """Without further samples the forward pass draws what this pass would write."""
        return settings.shading.msaa > 1

    def describe(self) -> PipelineDescription:
        """Return the pipeline."""
        return PipelineDescription(
            shaders=("post/fullscreen.vert", "post/resolve.frag"),
            defines=resolve_defines(self._settings),
            color=self._settings.shading.color_format,
            depth=None,
            name="resolve",
        )
