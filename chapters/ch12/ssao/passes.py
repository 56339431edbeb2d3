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
from ..shading.deferred import code_defines, sampled
from . import model

_DEPTH = Access("depth", "sampled")
_ACROSS = "ambient_occlusion_x"


class OcclusionPass(FullscreenPass):
    """The common base: a triangle that writes visibility, by a shader of this folder."""

    shader = ""

    @staticmethod
    def needed(scene: Scene, settings: Settings) -> bool:
        """Whether anything shows occlusion."""
        return model.needed(scene, settings)

    def defines(self) -> model.Defines:
        """Return what the shader is built with."""
        return ()

    def constants(self) -> model.Constants:
        """Return the specialization constants of the pipeline."""
        raise NotImplementedError

    def describe(self) -> PipelineDescription:
        """Return the pipeline."""
        shaders = "post/fullscreen.vert", f"ssao/{self.shader}"
        return PipelineDescription(
            shaders, self.defines(), self.constants(), color=model.FORMAT, depth=None, name=self.name
        )


class SsaoPass(OcclusionPass):
    """Estimates for each pixel the part of the light from everywhere that its surroundings let through."""

    name, shader = "ssao", "ssao.frag"
    writes = (Access(model.RAW, "color", format=model.FORMAT),)

    def __init__(self, parts: PassParts) -> None:
        super().__init__(parts)
        normals = parts.settings.ssao.mode == "normals"
        self.reads = (_DEPTH, sampled(parts.settings)[1]) if normals else (_DEPTH,)

    def defines(self) -> model.Defines:
        """Return the mode, and how normals are stored."""
        return (*model.trace_defines(self._settings), *code_defines(self._settings))

    def constants(self) -> model.Constants:
        """Return the radius, and the points along each ray."""
        return model.trace_constants(self._settings)


class SsaoBlurPass(OcclusionPass):
    """Blurs along one axis of the picture, within a surface: along x what was estimated, along y the result of that."""

    shader = "ssao_blur.frag"

    def __init__(self, parts: PassParts, step: tuple[int, int]) -> None:
        super().__init__(parts)
        self._step = step
        across = step == (1, 0)
        self.name = "ssao_blur_x" if across else "ssao_blur"
        source, target = (model.RAW, _ACROSS) if across else (_ACROSS, model.RESULT)
        self.reads = (Access(source, "sampled"), _DEPTH)
        # Where a pass of the blur is left out, the estimate stands in for both.
        self.writes = (Access(target, "color", format=model.FORMAT, instead=model.RAW),)

    @staticmethod
    def needed(scene: Scene, settings: Settings) -> bool:
        """Whether there is anything to blur."""
        return settings.ssao.blur and model.needed(scene, settings)

    def constants(self) -> model.Constants:
        """Return the step from tap to tap, and what is of one surface."""
        return model.blur_constants(self._settings, self._step)
