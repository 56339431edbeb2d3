"""The transparent pass: what lets light through, over what the lighting pass has lit."""

from __future__ import annotations

from backends.contract import Access
from common.scene import Scene

from ..pipelines.vulkan import GraphicsPipeline, Pipelines
from ..scene.packing import Variant
from ..scene.vulkan_data import SceneData
from ..settings import Settings
from .deferred import has_transparent
from .vulkan_forward import ForwardPass
from .vulkan_objects import ObjectsPass


class TransparentPass(ObjectsPass):
    """Draws blended objects as the forward path does, farthest first, each one shaded while it is drawn.

    A G-buffer has room for one surface at each pixel, so what lies over another one has to bring its light with it.
    """

    name = "transparent"
    transparent = True

    def __init__(
        self, forward: ForwardPass, settings: Settings, data: SceneData, pipelines: Pipelines
    ) -> None:
        super().__init__(forward, settings, data, pipelines)
        self.reads = (Access("depth", "depth"),)
        self.writes = (Access("color_hdr", "color", format=settings.color_format, of="color_lit"),)

    @staticmethod
    def needed(scene: Scene, settings: Settings) -> bool:
        """Whether any object is transparent; else what was lit is the picture."""
        return has_transparent(scene)

    def describe(self, variant: Variant) -> GraphicsPipeline:
        """Return the forward pass's pipeline."""
        return self._forward.describe(variant)
