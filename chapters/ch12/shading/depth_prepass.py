"""The depth pre-pass: how far away the nearest surface is at each pixel, before any of them is shaded."""

from __future__ import annotations

from backends.contract import Access
from common.scene import Scene

from ..pipelines.description import PipelineDescription
from ..scene.packing import Variant, shape_alone
from ..scene.pass_parts import PassParts
from ..settings import Settings
from . import views
from .objects import ObjectsPass
from .prepass import has_prepass
from .samples import coverage_defines


class DepthPrepass(ObjectsPass):
    """Draws the solid objects without colour, with one pipeline for all that are opaque.

    The pass that shades tests for equal depth then, and so shades each pixel once, however many surfaces lie behind one
    another. That pays where shading is dear and overdraw is high: all vertices are transformed twice. An opaque surface
    runs no fragment shader here; a masked one has to ask its texture where it has holes.

    Equal means equal bits. Both passes run the one function of transform.glsl, which is `precise` and `invariant`.
    """

    name = "depth_prepass"
    shape_only = True

    def __init__(self, parts: PassParts) -> None:
        super().__init__(parts)
        depth, samples = views.depth_target(parts.settings), parts.settings.shading.msaa
        self.writes = (Access(depth, "depth", format="d32f", clear=(0.0,), samples=samples),)

    @staticmethod
    def needed(scene: Scene, settings: Settings) -> bool:
        """Whether it is asked for; a scene with nothing in it has a depth, too."""
        return has_prepass(settings)

    def describe(self, variant: Variant) -> PipelineDescription:
        """Return the pipeline: without a fragment shader, unless a mask decides."""
        shape = shape_alone(variant)
        masked = shape.has("ALPHA_MASK")
        return PipelineDescription(
            shaders=("shading/forward.vert", "shading/forward.frag") if masked else ("shading/forward.vert",),
            defines=(
                *shape.defines,
                *self._data.texture_defines(shape, shape_alone),
                *coverage_defines(variant, self._settings),
                *((("DEPTH_ALONE", 1),) if masked else ()),
            ),
            color=None,
            samples=self._settings.shading.msaa,
            name="depth masked" if masked else "depth",
        )
