"""The sharpening pass: differences from the mean around a pixel become larger."""

from __future__ import annotations

from backends.contract import Access, Sources
from common.scene import Scene

from ..pipelines.description import PipelineDescription
from ..scene.pass_parts import PassParts
from . import finish
from .fullscreen import FullscreenPass


class SharpenPass(FullscreenPass):
    """One triangle over the whole picture, in linear light; see finish.py for its place."""

    name = "sharpen"
    reads = (Access("color_hdr", "sampled"),)
    sources = Sources()

    def __init__(self, parts: PassParts) -> None:
        super().__init__(parts)
        self._format = parts.settings.shading.color_format
        self.writes = (Access("color_sharp", "color", format=self._format, instead="color_hdr"),)

    @staticmethod
    def needed(scene: Scene, settings: finish.Settings) -> bool:
        """Whether anything is added."""
        return settings.finish.sharpen > 0.0 and finish.shows_picture(settings)

    def describe(self) -> PipelineDescription:
        """Return the pipeline."""
        return PipelineDescription(
            shaders=("post/fullscreen.vert", "post/sharpen.frag"),
            defines=(("AMOUNT", self._settings.finish.sharpen),),
            color=self._format,
            depth=None,
            name="sharpen",
        )
