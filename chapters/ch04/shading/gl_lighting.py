"""The lighting pass: every pixel's surface out of the G-buffer, lit by all lights."""

from __future__ import annotations

from backends.contract import Access
from common.scene import Scene

from ..pipelines.gl import GraphicsPipeline, Pipelines
from ..post.gl_fullscreen import FullscreenPass
from ..scene.gl_data import SceneData
from ..settings import Settings
from .deferred import TARGETS, light_defines
from .gl_forward import ForwardPass


class LightingPass(FullscreenPass):
    """Lights each pixel once; where nothing was drawn it shows the sky, or the background's grey."""

    name = "lighting"

    def __init__(
        self, forward: ForwardPass, settings: Settings, data: SceneData, pipelines: Pipelines
    ) -> None:
        super().__init__(forward, settings, data, pipelines)
        self.reads = tuple(Access(name, "sampled") for name in (*TARGETS, "depth"))
        self.writes = (Access("color_lit", "color", format=settings.color_format),)

    @staticmethod
    def needed(scene: Scene, settings: Settings) -> bool:
        """Even an empty scene has a background."""
        return True

    def describe(self) -> GraphicsPipeline:
        """Return the pipeline, with the lights and the environment that any of the materials takes part in."""
        variants = [self._data.variants[material] for material in self._forward.used]
        return GraphicsPipeline(
            shaders=("post/fullscreen.vert", "shading/lighting.frag"),
            defines=light_defines(variants, self._forward.has_sky, self._settings),
            depth=None,
            name="lighting",
        )
