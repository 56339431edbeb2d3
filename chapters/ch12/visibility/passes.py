"""The geometry pass of the visibility buffer: the number of the nearest triangle at each pixel, and its depth."""

from __future__ import annotations

from backends.contract import Access
from common.scene import Scene

from ..pipelines.description import PipelineDescription
from ..scene.packing import Variant, shape_alone
from ..scene.pass_parts import PassParts
from ..settings import Settings
from ..shading import views
from ..shading.forward import depth_accesses
from ..shading.objects import ObjectsPass
from .model import FORMAT, VISIBILITY, flag_defines, in_use


class VisibilityPass(ObjectsPass):
    """Draws the solid objects in place of the G-buffer pass, and stores 8 bytes a pixel.

    A rasteriser shades in quads of 2x2 pixels: a triangle of one pixel costs four runs of its fragment shader, and what
    is covered later costs as much as what is seen. Here that shader stores two numbers. Materials are evaluated
    afterwards, once for each pixel (resolve.py). All opaque materials share one pipeline; a masked one asks its texture
    where it has holes, as in the depth pre-pass.
    """

    name = VISIBILITY
    shape_only = True

    def __init__(self, parts: PassParts) -> None:
        super().__init__(parts)
        self.reads, depth = depth_accesses(parts.settings)
        self.writes = (Access(VISIBILITY, "color", format=FORMAT, clear=(0, 0, 0, 0)), *depth)

    @staticmethod
    def needed(scene: Scene, settings: Settings) -> bool:
        """Whether surfaces are found from numbers of triangles."""
        return in_use(settings)

    def describe(self, variant: Variant) -> PipelineDescription:
        """Return the pipeline: one for all opaque materials."""
        shape = shape_alone(variant)
        textures = self._data.texture_defines(shape, shape_alone)
        return PipelineDescription(
            shaders=("shading/forward.vert", "visibility/ids.frag"),
            defines=(*shape.defines, *textures, ("TRIANGLE_ID", 1), *flag_defines()),
            color=FORMAT,
            depth=views.depth_use(self._settings, variant),
            name="visibility masked" if shape.has("ALPHA_MASK") else "visibility",
        )
