"""The lighting pass: every pixel's surface out of the G-buffer, lit by all lights."""

from __future__ import annotations

from backends.contract import Access
from common.scene import Scene

from ..pipelines.description import PipelineDescription
from ..post.fullscreen import FullscreenPass
from ..scene.pass_parts import PassParts
from ..settings import Settings
from ..ssao import model as ssao
from .deferred import TARGETS, light_defines
from .sky import Sky


class LightingPass(FullscreenPass):
    """Lights each pixel once; where nothing was drawn it shows the sky, or the background's grey."""

    name = "lighting"

    def __init__(self, parts: PassParts) -> None:
        super().__init__(parts)
        self._has_sky = Sky.needed(parts.scene, parts.settings)
        self._occlusion = ssao.light_defines(parts.scene, parts.settings)
        occlusion = (ssao.RESULT,) if self._occlusion else ()
        self.reads = tuple(Access(name, "sampled") for name in (*TARGETS, "depth", *occlusion))
        self.writes = (Access("color_lit", "color", format=parts.settings.shading.color_format),)

    @staticmethod
    def needed(scene: Scene, settings: Settings) -> bool:
        """Even an empty scene has a background."""
        return True

    def describe(self) -> PipelineDescription:
        """Return the pipeline, with the lights and the environment that any of the materials takes part in."""
        variants = [self._data.variants[material] for material in self._draws.used]
        return PipelineDescription(
            shaders=("post/fullscreen.vert", "shading/lighting.frag"),
            defines=(*light_defines(variants, self._has_sky, self._settings), *self._occlusion),
            color=self._settings.shading.color_format,
            depth=None,
            name="lighting",
        )
