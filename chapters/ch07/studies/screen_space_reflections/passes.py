"""The two passes of reflections: `reflection_trace` finds a place for each pixel, `reflections` takes the light there.

Both read the G-buffer. Between them is an image of places, not of colours: a box of neighbours then averages the light
at their places, and one image serves the lookup and the blur.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from backends.contract import Access, Pass
from common.scene import Scene

from ...pipelines.description import PipelineDescription
from ...post.fullscreen import FullscreenPass
from ...scene.pass_parts import PassParts
from ...shading.deferred import sampled
from ...shading.lighting import LightingPass
from ...ssao import model as ssao
from . import model

LIT, REFLECTED = "color_lit", "color_reflected"
HITS = "reflection_hits"
"""Of each pixel: column and row at which its ray ends, the weight of the light there, and 1 if the surface reflects."""


class ReflectionPass(FullscreenPass):
    """A triangle over the picture, whose shader is built with the lights' defines and those of reflections.

    It reads depth, normals and materials, in the order of surface.glsl, and what a pass names besides.
    """

    shader: str

    def __init__(self, parts: PassParts, reads: tuple[str, ...], write: Access) -> None:
        super().__init__(parts)
        self._lighting = LightingPass(parts)
        _, *surface = sampled(parts.settings)
        others = tuple(Access(name, "sampled") for name in reads)
        self.reads = (Access("depth", "sampled"), *surface, *others)
        self.writes = (write,)

    @staticmethod
    def needed(scene: Scene, settings: Any) -> bool:
        """Whether anything reflects; else what was lit is the picture."""
        return model.needed(scene, settings)

    def describe(self) -> PipelineDescription:
        """Return the pipeline."""
        lighting = self._lighting.describe()
        return replace(
            lighting,
            shaders=(lighting.shaders[0], f"studies/screen_space_reflections/{self.shader}"),
            defines=(*lighting.defines, *model.defines(self._settings)),  # type: ignore[arg-type]
            color=self.writes[0].format,
            name=self.name,
        )


class TracePass(ReflectionPass):
    """Marches the mirrored ray of each pixel. Whole floats hold the places: a half ends at 2048 pixels."""

    name, shader = "reflection_trace", "trace.frag"

    def __init__(self, parts: PassParts) -> None:
        super().__init__(parts, (), Access(HITS, "color", format="rgba32f"))


class ResolvePass(ReflectionPass):
    """Replaces the environment's light by that at the places of a box; without it, `color_lit` is the picture."""

    name, shader = "reflections", "resolve.frag"

    def __init__(self, parts: PassParts) -> None:
        color = parts.settings.shading.color_format
        write = Access(REFLECTED, "color", format=color, instead=LIT)
        occlusion = (ssao.RESULT,) if ssao.needed(parts.scene, parts.settings) else ()
        super().__init__(parts, ("gbuffer_base_color", LIT, HITS, *occlusion), write)


def readers_of(passes: dict[str, Pass]) -> dict[str, dict[str, str]]:
    """Return what has to read the reflected picture: every pass that reads the lit one, or draws over it."""
    return {
        name: {LIT: REFLECTED}
        for name, read_by in passes.items()
        if LIT in [access.resource for access in read_by.reads] + [access.of for access in read_by.writes]
    }
