"""The pass that draws shadow maps, before the passes that light surfaces.

    for each round: faces of one size -> layers of a depth target -> store.comp -> pages

The pass begins and ends rendering by itself: a frame draws as many faces as have changed, and attachments that the graph
declares are of a fixed number. For the graph it is a pass that stores to the pages.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace
from typing import Any

import numpy as np

from backends.contract import Access, Pass
from common.scene import Scene

from ..frames.commands import Commands
from ..graph.types import External, Touch
from ..pipelines.compute_description import ComputeDescription
from ..pipelines.description import Built, PipelineDescription
from ..scene.packing import Variant, shape_alone
from ..scene.pass_parts import PassParts
from ..settings import Settings
from ..shading.objects import ObjectsPass
from .memory import ShadowMemory, layers_of
from .model import needed

PAGES = "shadow_pages"
"""The resource in the graph."""

LIT = ("forward", "forward_late", "lighting", "lighting_compute", "transparent", "transparent_fill")
"""The passes that read shadows."""

_READ = Touch("", frozenset({"fragment", "compute"}), frozenset({"storage_read"}))
"""The last use in the frame before."""

Rounds = tuple[tuple[int, int, int], ...]
"""(size, first, count) of the faces that are drawn together."""


def rounds_of(sizes: Collection[int]) -> Rounds:
    """Return the rounds of faces of these sizes, which stand together by size."""
    rounds: list[tuple[int, int, int]] = []
    for number, size in enumerate(sizes):
        if rounds and rounds[-1][0] == size and rounds[-1][2] < layers_of(size):
            rounds[-1] = (size, rounds[-1][1], rounds[-1][2] + 1)
        else:
            rounds.append((size, number, 1))
    return tuple(rounds)


class ShadowsPass(ObjectsPass):
    """Draws all solid objects into each face that is due, and copies it into its pages.

    Both sides of a surface cast a shadow: light that comes from behind a wall is stopped by it, too. An opaque material
    runs no fragment shader; a masked one asks its texture where it has holes. Blended objects cast none, nor does what
    is unlit: it shows pictures, such as a sky around the scene, and the light of lamps.
    """

    name = "shadows"
    shape_only = True
    draws_solid = False  # in the lists of culling for the camera
    phases = ()

    def __init__(self, parts: PassParts) -> None:
        super().__init__(parts)
        self.memory: ShadowMemory | None = None
        """The memory of this backend, from the technique."""
        self.rounds: Rounds = ()
        """What the frame draws."""
        self.writes = (Access(PAGES, "storage", bytes=4),)
        self.externals = {PAGES: External(None, None, _READ, bytes=4)}
        self._kernel: Built

    @staticmethod
    def needed(scene: Scene, settings: Settings) -> bool:
        """Whether any light casts shadows."""
        return needed(scene, settings)

    def takes(self, variant: Variant) -> bool:
        """Whether materials of `variant` cast shadows."""
        return variant.alpha_mode != "blend" and variant.has("SHADED")

    def describe(self, variant: Variant) -> PipelineDescription:
        """Return the pipeline: one for all opaque materials."""
        shape = shape_alone(variant)
        masked = shape.has("ALPHA_MASK")
        return PipelineDescription(
            shaders=("shadows/caster.vert", "shading/forward.frag") if masked else ("shadows/caster.vert",),
            defines=(
                *shape.defines,
                *self._data.texture_defines(shape, shape_alone),
                *((("DEPTH_ALONE", 1),) if masked else ()),
            ),
            color=None,
            name="shadow masked" if masked else "shadow",
        )

    def create(self) -> None:
        """Build the pipelines of casters, and the kernel that copies faces."""
        super().create()
        (self._kernel,) = self._pipelines.get([ComputeDescription("shadows/store.comp", name="store shadow faces")])

    def record(self, commands: Any) -> None:
        """Record the rounds of this frame. Draws of casters are counted apart from those of the picture."""
        memory = self.memory
        assert memory is not None, "the technique has made it"
        before = dict(commands.work)
        variants = self._data.variants
        solid = [batch for batch in self._draws.solid if self.takes(variants[batch.material])]
        casters = [replace(group, cull=False) for group in self.groups(solid)]
        for size, first, count in self.rounds:
            memory.begin_round(commands, size)
            for layer in range(count):
                memory.begin_face(commands, size, layer)
                number = np.array([[first + layer, 0, 0, 0]], np.uint32)
                commands.draw_groups(casters, self._draws.binding._replace(pushed=number))
                memory.end_face(commands)
            memory.store(commands, self._kernel, size, first, count)
        memory.finish(commands)
        for name in ("draws", "draw_calls", "triangles"):
            commands.work[f"shadow_{name}"] = commands.work[name] - before[name]
            commands.work[name] = before[name]

    def key(self, slot: int) -> Any:
        """Return the lists of the scene, and the rounds."""
        return self._draws.key(slot), self.rounds


def read_pages(passes: Collection[Pass]) -> None:
    """Declare in the passes that light surfaces that they load shadows."""
    for gpu_pass in passes:
        gpu_pass.reads = (*gpu_pass.reads, Access(PAGES, "storage"))


