"""The passes of depth peeling.

peel_0 -> peel_1 -> ... -> peel_n      each with the depth of the one before
color_lit -> over_n -> ... -> over_0   from the farthest layer to the nearest -> color_hdr
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

from backends.contract import Access, Pass, Sources
from common.scene import Scene

from ...frames.commands import Commands, DrawGroup, SceneBinding
from ...pipelines.description import PipelineDescription
from ...post.fullscreen import FullscreenPass
from ...scene.packing import Variant
from ...scene.pass_parts import PassParts
from ...shading.deferred import has_transparent
from ...shading.transparent import TransparentPass

Draw = Callable[[Any, Sequence[DrawGroup], SceneBinding], None]

DEPTHS = Sources(set=3, first={"texture": 14})
"""The bindings of the depths, behind those of materials."""


class PeelPass(TransparentPass):
    """Draws layer number `layer` of each pixel.

    `lists` are the draw commands that culling has left; `draw` records draws that also bind the sources.
    """

    sources = DEPTHS

    def __init__(self, parts: PassParts, layer: int, lists: tuple[Access, ...], draw: Draw) -> None:
        super().__init__(parts)
        self._draw = draw
        self.layer, self.name = layer, f"peel_{layer}"
        depths = ["depth", *([f"peeled_depth_{layer - 1}"] if layer else [])]
        self.reads = (*(Access(name, "sampled") for name in depths), *lists)
        nothing = (0.0, 0.0, 0.0, 0.0)
        self.writes = (
            Access(f"peeled_{layer}", "color", format=parts.settings.shading.color_format, clear=nothing),
            Access(f"peeled_depth_{layer}", "depth", format="d32f", clear=(0.0,)),
        )

    @staticmethod
    def needed(scene: Scene, settings: Any) -> bool:
        """Whether anything is transparent."""
        return has_transparent(scene)

    def describe(self, variant: Variant) -> PipelineDescription:
        """Return the chapter's pipeline, with a depth test among the layers in place of blending."""
        lit = super().describe(variant)
        return replace(
            lit,
            shaders=(lit.shaders[0], "studies/depth_peeling/peel.frag"),
            defines=(*lit.defines, *((("BEHIND", 1),) if self.layer else ())),
            depth="write",
            blend=None,
            name=f"peeled {lit.name}",
        )

    def record(self, commands: Commands) -> None:
        """Record the draws, with the depths bound behind the sets of materials."""
        groups, binding = self.groups(self._draws.transparent), self._draws.transparent_binding
        self._draw(commands, groups, binding)


class OverPass(FullscreenPass):
    """Blends layer number `layer` over what is behind it; layer 0 is the last."""

    sources = Sources()

    def __init__(self, parts: PassParts, layer: int, count: int) -> None:
        super().__init__(parts)
        self.name = f"over_{layer}"
        behind = f"color_over_{layer + 1}" if layer + 1 < count else "color_lit"
        written = f"color_over_{layer}" if layer else "color_hdr"
        self._format = parts.settings.shading.color_format
        self.reads = (Access(f"peeled_{layer}", "sampled"),)
        self.writes = (Access(written, "color", format=self._format, of=behind),)

    @staticmethod
    def needed(scene: Scene, settings: Any) -> bool:
        """Whether anything is transparent."""
        return has_transparent(scene)

    def describe(self) -> PipelineDescription:
        """Return the pipeline of the triangle."""
        return PipelineDescription(
            shaders=("post/fullscreen.vert", "studies/depth_peeling/over.frag"),
            color=self._format,
            depth=None,
            blend="over",
            name="a layer over what is behind it",
        )


def peeling_passes(parts: PassParts, count: int, sorted_objects: Pass, draw: Draw) -> list[Pass]:
    """Return the passes for `count` layers, which take the place of `sorted_objects`."""
    lists = tuple(access for access in sorted_objects.reads if access.use == "indirect")
    peels = [PeelPass(parts, layer, lists, draw) for layer in range(count)]
    return [*peels, *(OverPass(parts, layer, count) for layer in range(count))]
