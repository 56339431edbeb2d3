"""The motion-blur pass: light along the way of each pixel while the shutter is open."""

from __future__ import annotations

from backends.contract import Access, Sources
from common.scene import Scene

from ..pipelines.description import PipelineDescription
from ..scene.pass_parts import PassParts
from . import finish
from .fullscreen import FullscreenPass


class MotionBlurPass(FullscreenPass):
    """One triangle over the whole picture, in linear light; see finish.py for its place.

    Ways are those of the surfaces that are seen. A surface that stands still beside one that moves stays sharp.
    """

    name = "motion_blur"
    reads = (Access("color_hdr", "sampled"), Access("motion", "sampled"))
    sources = Sources()

    def __init__(self, parts: PassParts) -> None:
        super().__init__(parts)
        self._format = parts.settings.shading.color_format
        self.writes = (Access("color_blurred", "color", format=self._format, instead="color_hdr"),)

    @staticmethod
    def needed(scene: Scene, settings: finish.Settings) -> bool:
        """Whether the shutter is open for any time, and anything can be seen to move."""
        return finish.has_motion_blur(settings) and len(scene.instances) > 0

    def describe(self) -> PipelineDescription:
        """Return the pipeline."""
        knobs = self._settings.finish
        return PipelineDescription(
            shaders=("post/fullscreen.vert", "post/motion_blur.frag"),
            defines=(
                ("SHUTTER", knobs.motion_blur),
                ("TAPS", knobs.motion_blur_taps),
                ("LONGEST", knobs.motion_blur_limit),
            ),
            color=self._format,
            depth=None,
            name="motion blur",
        )
