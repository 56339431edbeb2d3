"""The FXAA pass: edges of the finished picture are smoothed by their contrast."""

from __future__ import annotations

from backends.contract import Access
from common.scene import Scene

from ..pipelines.description import PipelineDescription
from ..scene.pass_parts import PassParts
from . import finish
from .fullscreen import FullscreenPass


class FxaaPass(FullscreenPass):
    """One triangle over the whole picture, after the tone curve; it then is the last pass. See shaders/fxaa.glsl."""

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

    def describe(self) -> PipelineDescription:
        """Return the pipeline."""
        knobs = self._settings.finish
        return PipelineDescription(
            shaders=("post/fullscreen.vert", "post/fxaa.frag"),
            defines=(
                ("CONTRAST", knobs.fxaa_contrast),
                ("LEAST_CONTRAST", finish.LEAST_CONTRAST),
                ("DETAIL", knobs.fxaa_detail),
                ("STEPS", knobs.fxaa_steps),
                *finish.last_defines(self._settings, self.reads),
            ),
            color="rgba8",
            depth=None,
            name="fxaa",
        )
