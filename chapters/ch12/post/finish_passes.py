"""The passes that finish the picture besides the tone curve: motion blur, sharpening and FXAA; see finish.py."""

from __future__ import annotations

from backends.contract import Access, Sources
from common.scene import Scene

from ..pipelines.description import PipelineDescription
from ..scene.pass_parts import PassParts
from . import finish
from .fullscreen import FullscreenPass


class FinishPass(FullscreenPass):
    """The common base: one triangle over the whole picture, by the fragment shader of the pass's name."""

    sources = Sources()

    def __init__(self, parts: PassParts) -> None:
        super().__init__(parts)
        self.knobs = parts.settings.post

    def defines(self) -> finish.Defines:
        """Return what the shader is built with."""
        raise NotImplementedError

    def describe(self) -> PipelineDescription:
        """Return the pipeline."""
        shaders = ("post/fullscreen.vert", f"post/{self.name}.frag")
        (target,) = self.writes
        return PipelineDescription(shaders, self.defines(), color=target.format, depth=None, name=self.name)

    def of_light(self, name: str) -> tuple[Access, ...]:
        """Return the write of linear light that takes the place of "color_hdr"."""
        return (Access(name, "color", format=self._settings.shading.color_format, instead="color_hdr"),)


class MotionBlurPass(FinishPass):
    """Spreads light along the way of each pixel while the shutter is open.

    Ways are those of the surfaces that are seen. A surface that stands still beside one that moves stays sharp.
    """

    name = "motion_blur"
    reads = (Access("color_hdr", "sampled"), Access("motion", "sampled"))

    def __init__(self, parts: PassParts) -> None:
        super().__init__(parts)
        self.writes = self.of_light("color_blurred")

    @staticmethod
    def needed(scene: Scene, settings: finish.Settings) -> bool:
        """Whether the shutter is open for any time, and there is anything that can move."""
        return finish.has_motion_blur(settings) and len(scene.instances) > 0

    def defines(self) -> finish.Defines:
        """Return the time that the shutter is open, and the limits."""
        knobs = self.knobs
        return (
            ("SHUTTER", knobs.motion_blur),
            ("TAPS", knobs.motion_blur_taps),
            ("LONGEST", knobs.motion_blur_limit),
        )


class SharpenPass(FinishPass):
    """Makes differences from the mean around a pixel larger."""

    name = "sharpen"
    reads = (Access("color_hdr", "sampled"),)

    def __init__(self, parts: PassParts) -> None:
        super().__init__(parts)
        self.writes = self.of_light("color_sharp")

    @staticmethod
    def needed(scene: Scene, settings: finish.Settings) -> bool:
        """Whether anything is added."""
        return settings.post.sharpen > 0.0 and finish.shows_picture(settings)

    def defines(self) -> finish.Defines:
        """Return the amount."""
        return (("AMOUNT", self.knobs.sharpen),)


class FxaaPass(FinishPass):
    """Smooths edges of the picture by their contrast, after the tone curve. It then is the last pass."""

    name = "fxaa"
    writes = (Access("color", "color", format="rgba8", instead=finish.TONED),)

    def __init__(self, parts: PassParts) -> None:
        super().__init__(parts)
        self.sources = finish.last_sources(parts.settings)
        self.reads = (Access(finish.TONED, "sampled"), *finish.last_reads(parts.settings))

    @staticmethod
    def needed(scene: Scene, settings: finish.Settings) -> bool:
        """Whether edges are smoothed."""
        return finish.has_fxaa(settings)

    def defines(self) -> finish.Defines:
        """Return the thresholds, and what the last pass does besides."""
        knobs = self.knobs
        return (
            ("CONTRAST", knobs.fxaa_contrast),
            ("LEAST_CONTRAST", finish.LEAST_CONTRAST),
            ("DETAIL", knobs.fxaa_detail),
            ("STEPS", knobs.fxaa_steps),
            *finish.last_defines(self._settings, self.reads),
        )
