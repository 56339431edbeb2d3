"""The depth-of-field pass: the sharp picture and the blurred one become what the lens shows."""

from __future__ import annotations

from backends.contract import Access
from common.scene import Scene

from ..pipelines.gl import GraphicsPipeline, Pipelines
from ..scene.gl_data import SceneData
from ..settings import Settings
from ..shading.gl_forward import ForwardPass
from . import lens
from .gl_fullscreen import FullscreenPass


class DepthOfFieldPass(FullscreenPass):
    """The last of the lens's three passes. Without them the picture is sharp all over."""

    name = "depth_of_field"
    reads = tuple(Access(name, "sampled") for name in ("color_hdr", "depth", "dof_blurred", "dof_near"))

    def __init__(
        self, forward: ForwardPass, settings: Settings, data: SceneData, pipelines: Pipelines
    ) -> None:
        super().__init__(forward, settings, data, pipelines)
        self.writes = (Access("color_focused", "color", format=settings.color_format, instead="color_hdr"),)

    @staticmethod
    def needed(scene: Scene, settings: Settings) -> bool:
        """Whether the lens has an opening, and there is anything before it."""
        return lens.needed(scene, settings)

    def describe(self) -> GraphicsPipeline:
        """Return the pipeline."""
        return GraphicsPipeline(
            shaders=("post/fullscreen.vert", "post/depth_of_field.frag"),
            defines=lens.lens_defines(self._settings),
            depth=None,
            name="depth of field",
        )
