"""The passes of ambient occlusion, between the G-buffer and the light: the estimate, and its blur along x and y.

    depth (and gbuffer_normal) -> ssao -> ssao_blur_x -> ssao_blur -> ambient_occlusion -> lighting

Without the blur the light reads the estimate itself.
"""

from __future__ import annotations

from backends.contract import Access
from common.scene import Scene

from ..pipelines.description import PipelineDescription
from ..post.fullscreen import FullscreenPass
from ..scene.pass_parts import PassParts
from ..settings import Settings
from ..shading.deferred import normal_defines
from . import model

_DEPTH = Access("depth", "sampled")
_ACROSS = "ambient_occlusion_x"


class SsaoPass(FullscreenPass):
    """Estimates for each pixel the part of the light from everywhere that its surroundings let through."""

    name = "ssao"
    writes = (Access(model.RAW, "color", format=model.FORMAT),)

    def __init__(self, parts: PassParts) -> None:
        super().__init__(parts)
        normals = parts.settings.ssao.method == "normals"
        self.reads = (_DEPTH, Access("gbuffer_normal", "sampled")) if normals else (_DEPTH,)

    @staticmethod
    def needed(scene: Scene, settings: Settings) -> bool:
        """Whether anything shows occlusion."""
        return model.needed(scene, settings)

    def describe(self) -> PipelineDescription:
        """Return the pipeline."""
        return PipelineDescription(
            shaders=("post/fullscreen.vert", "ssao/ssao.frag"),
            defines=(*model.trace_defines(self._settings), *normal_defines(self._settings)),
            color=model.FORMAT,
            depth=None,
            name=self.name,
        )


class SsaoBlurPass(FullscreenPass):
    """Blurs along one axis of the picture, within a surface: along x what was estimated, along y the result of that."""

    def __init__(self, parts: PassParts, step: tuple[int, int]) -> None:
        super().__init__(parts)
        self._step = step
        across = step == (1, 0)
        self.name = "ssao_blur_x" if across else "ssao_blur"
        source, target = (model.RAW, _ACROSS) if across else (_ACROSS, model.RESULT)
        self.reads = (Access(source, "sampled"), _DEPTH)
        self.writes = (Access(target, "color", format=model.FORMAT, instead=model.RAW),)

    @staticmethod
    def needed(scene: Scene, settings: Settings) -> bool:
        """Whether there is anything to blur."""
        return settings.ssao.blur and model.needed(scene, settings)

    def describe(self) -> PipelineDescription:
        """Return the pipeline."""
        return PipelineDescription(
            shaders=("post/fullscreen.vert", "ssao/ssao_blur.frag"),
            defines=model.blur_defines(self._settings, self._step),
            color=model.FORMAT,
            depth=None,
            name=self.name,
        )
