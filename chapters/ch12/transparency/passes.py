"""The passes of transparency that does not depend on the order of draws.

    lists      transparent_clear -> transparent_count -> transparent_sums -> transparent_fill -> transparent_resolve
    weighted   transparent_fill -> transparent_resolve

The blended objects are drawn twice for lists. First their fragments are counted, so that a prefix sum gives each pixel
a range of the pool; then they are shaded, and stored in these ranges. The fill has the targets of weighted blending,
too, and draws to them if the pool is too small. The GPU decides that: the passes are the same in every frame.
"""

from __future__ import annotations

from typing import Any

from backends.contract import Access, Pass
from common.scene import Scene

from ..frames.commands import Commands
from ..graph.types import External, Touch
from ..hdr.model import automatic, skips_empty
from ..pipelines.compute_description import ComputeDescription
from ..pipelines.description import PipelineDescription
from ..scene.packing import Variant, shape_alone
from ..scene.pass_parts import PassParts
from ..shading.deferred import has_transparent
from ..shading.forward import describe_lit
from ..shading.transparent import TransparentPass
from .kernels import RESOLVED
from .memory import RUNS, LayerMemory
from .model import SHORT, Settings, layered, uses_lists

WORDS = ("layer_words", "layer_counts", "layer_starts", "layer_ends")
"""The resource with a word for each pixel, by the passes that write it."""

NODES = ("layer_nodes", "layer_order")
"""The resource of the layers, as they come and sorted."""

SUMS, WEIGHTS = RESOLVED[1:]
"""The targets of weighted blending. Half precision would not do: 10,000 weights add up beyond its range."""

_READ = Touch("", frozenset({"compute"}), frozenset({"storage_read"}))
_STORED = Touch("", frozenset({"compute"}), frozenset({"storage_read", "storage_write"}), writes=True)

DEFINES = (("LISTS", 1), ("SHORT", f"{SHORT}u"))
"""The defines of shaders that read or write lists."""


def _buffer(name: str, of: str = "") -> Access:
    return Access(name, "storage", bytes=4, of=of)


class LayerPass(Pass):
    """A pass of dispatches on the words of pixels."""

    def __init__(self, memory: LayerMemory) -> None:
        self._memory = memory

    @staticmethod
    def needed(scene: Scene, settings: Settings) -> bool:
        """Whether pixels have lists, and anything is transparent."""
        return uses_lists(settings) and has_transparent(scene)

    def key(self, slot: int) -> Any:
        """Return the revision of the memory."""
        return self._memory.revision


class ClearPass(LayerPass):
    """Sets the number of layers of each pixel to 0."""

    name = "transparent_clear"

    def __init__(self, memory: LayerMemory) -> None:
        super().__init__(memory)
        if memory.lists:
            self.writes = (_buffer(WORDS[0]),)
            self.externals = {
                WORDS[0]: External(None, None, _READ, bytes=4),
                NODES[0]: External(None, None, _STORED, bytes=4),
            }

    def create(self) -> None:
        """Build the pipeline."""
        described = ComputeDescription("transparency/clear.comp", RUNS, name="no layers")
        (self._pipeline,) = self._memory.build("clear", described)

    def record(self, commands: Commands) -> None:
        """Record one dispatch."""
        self._memory.run(commands, "clear", self._pipeline)


class SumsPass(LayerPass):
    """Turns the number of layers of each pixel into the sum of all before it, and decides whether all of them fit."""

    name = "transparent_sums"

    def __init__(self, memory: LayerMemory) -> None:
        super().__init__(memory)
        self.writes = (_buffer(WORDS[2], of=WORDS[1]),) if memory.lists else ()

    def create(self) -> None:
        """Build the pipelines of the three steps."""
        self._steps = self._memory.build(
            "sums",
            *(
                ComputeDescription(
                    "transparency/sums.comp", (*RUNS, ("STEP", step)), name=f"sums of layers {step}"
                )
                for step in range(3)
            ),
        )

    def record(self, commands: Commands) -> None:
        """Record the three steps; the second one is a single work group."""
        for step, pipeline in enumerate(self._steps):
            if step:
                commands.compute_barrier()
            self._memory.run(commands, "sums", pipeline, blocks=1 if step == 1 else None)
        self._memory.kernels.finish(commands, commands.slot.index)  # type: ignore[attr-defined]


class LayerDrawsPass(TransparentPass):
    """Draws the blended objects with buffers of layers."""

    kind = ""

    def __init__(self, parts: PassParts, memory: LayerMemory) -> None:
        super().__init__(parts)
        self._memory = memory
        self.writes = ()

    def create(self) -> None:
        """Build the pipelines."""
        super().create()
        for pipeline in self.pipelines[:1]:  # none while a material that became blended is not followed yet
            self._memory.set_pipeline(self.kind, pipeline)

    def record(self, commands: Commands) -> None:
        """Record the draws of this frame."""
        groups = self.groups(self._draws.transparent)
        self._memory.kernels.draw(commands, self.kind, groups, self._draws.transparent_binding)

    def key(self, slot: int) -> Any:
        """Return what the recorded draws depend on."""
        return super().key(slot), self._memory.revision


class CountPass(LayerDrawsPass):
    """Counts the fragments of blended objects in each pixel: it asks only where they are."""

    name, kind = "transparent_count", "count"
    shape_only = True

    def __init__(self, parts: PassParts, memory: LayerMemory) -> None:
        super().__init__(parts, memory)
        self.writes = (_buffer(WORDS[1], of=WORDS[0]),) if memory.lists else ()

    @staticmethod
    def needed(scene: Scene, settings: Settings) -> bool:
        """Whether pixels have lists, and anything is transparent."""
        return LayerPass.needed(scene, settings)

    def describe(self, variant: Variant) -> PipelineDescription:
        """Return the pipeline: positions, and a fragment shader without any material."""
        return PipelineDescription(
            shaders=("shading/forward.vert", "transparency/count.frag"),
            defines=shape_alone(variant).defines,
            color=None,
            depth="test",
            name="layers counted",
        )


class FillPass(LayerDrawsPass):
    """Shades the blended objects, and stores each fragment in the list of its pixel or adds it to a weighted mean."""

    name, kind = "transparent_fill", "fill"

    def __init__(self, parts: PassParts, memory: LayerMemory) -> None:
        super().__init__(parts, memory)
        if layered(parts.settings):
            self.writes = (
                Access(SUMS, "color", format="rgba32f", clear=(0.0, 0.0, 0.0, 1.0)),
                Access(WEIGHTS, "color", format="r32f", clear=(0.0, 0.0, 0.0, 0.0)),
            )
        if memory.lists:
            self.writes += (_buffer(WORDS[3], of=WORDS[2]), _buffer(NODES[0]))

    @staticmethod
    def needed(scene: Scene, settings: Settings) -> bool:
        """Whether anything is transparent, and is not sorted by object."""
        return layered(settings) and has_transparent(scene)

    def describe(self, variant: Variant) -> PipelineDescription:
        """Return the forward pass's pipeline, with another end of its fragment shader."""
        lit = describe_lit(self._data, self._settings, variant)
        lists = DEFINES if self._memory.lists else ()
        return PipelineDescription(
            shaders=lit.shaders,
            defines=(*lit.defines, ("LAYERS", 1), *lists),
            color=("rgba32f", "r32f"),
            depth="test",
            blend="weighted",
            name=f"layers {lit.name}",
        )


class ResolvePass(Pass):
    """Composites the layers of each pixel over what was lit before."""

    name = "transparent_resolve"

    def __init__(self, parts: PassParts, memory: LayerMemory) -> None:
        self._memory, self._format = memory, parts.settings.shading.color_format
        self._measured = automatic(parts.settings) and skips_empty(parts.scene, parts.settings)
        if layered(parts.settings):
            self.reads = (Access(SUMS, "storage"), Access(WEIGHTS, "storage"))
            self.writes = (Access("color_hdr", "storage", format=self._format, of="color_lit"),)
        if memory.lists:
            self.reads += (_buffer(WORDS[3]),)
            self.writes += (_buffer(NODES[1], of=NODES[0]),)

    @staticmethod
    def needed(scene: Scene, settings: Settings) -> bool:
        """Whether there are layers."""
        return FillPass.needed(scene, settings)

    def create(self) -> None:
        """Build the pipeline."""
        defines = (("FORMAT", self._format), *(DEFINES if self._memory.lists else ()))
        if self._measured:  # automatic exposure asks for what layers let through
            defines += (("MEASURED", 1),)
        described = ComputeDescription("transparency/resolve.comp", defines, name="layers composited")
        (self._pipeline,) = self._memory.build("resolve", described)

    def record(self, commands: Commands) -> None:
        """Record one dispatch over all pixels."""
        self._memory.kernels.bind(commands, "resolve", self._pipeline)
        commands.dispatch_over(self._pipeline, commands.extent)

    def key(self, slot: int) -> Any:
        """Return the revision of the memory."""
        return self._memory.revision
