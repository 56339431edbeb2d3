"""The pass that draws shadow maps, before the passes that light surfaces.

    for each round: lists.comp, commands.comp -> draws of some faces -> layers of a target -> store.comp -> pages

The pass begins and ends rendering by itself: a frame draws as many faces as have changed, and attachments that the
graph declares are of a fixed number. For the graph it is a pass that stores to the pages.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from backends.contract import Access, Pass
from common.scene import Scene

from ..frames.commands import Commands, DrawGroup
from ..graph.types import External, Touch
from ..mesh_layers.layered import LayeredCasters
from ..pipelines.compute_description import ComputeDescription
from ..pipelines.description import Built, PipelineDescription
from ..scene.packing import Variant, shape_alone
from ..scene.pass_parts import PassParts
from ..settings import Settings
from ..shading.objects import ObjectsPass
from .counts.model import ShadowCounts
from .lists import NO_ROUNDS, Round, ShadowLists
from .memory import ShadowMemory
from .model import needed

PAGES = "shadow_pages"
"""The resource in the graph."""

LIT = (
    *("forward", "forward_late", "transparent", "transparent_fill"),
    *("lighting", "lighting_compute", "lighting_blocks", "lighting_pixels"),
)
"""The passes that read shadows."""

_READ = Touch("", frozenset({"fragment", "compute"}), frozenset({"storage_read"}))
"""The last use in the frame before."""


class ShadowsPass(ObjectsPass):
    """Draws solid objects into each face that is due, and copies it into its pages.

    Both sides of a surface cast a shadow: light that comes from behind a wall is stopped by it, too. An opaque material
    runs no fragment shader; a masked one asks its texture where it has holes. Blended objects cast none, nor does what
    is unlit: it shows pictures, such as a sky around the scene, and the light of lamps.

    Where one call draws many commands, kernels write those of each face: what its light reaches, and the face sees.
    Else each face gets all draws.
    """

    name = "shadows"
    shape_only = True
    draws_solid = False  # in the lists of culling for the camera
    phases = ()

    def __init__(self, parts: PassParts) -> None:
        super().__init__(parts)
        self.memory: ShadowMemory | None = None
        """The memory of this backend, from the technique."""
        self.culls = self.counts_draws = False
        """Whether kernels write the commands of faces, and whether their number can be on the GPU."""
        self.schedule = NO_ROUNDS
        """What the frame draws."""
        self.lists: ShadowLists | None = None
        """The tables of casters, if kernels cull."""
        self.counts: ShadowCounts | None = None
        """The counters of what kernels leave to be drawn."""
        self.writes = (Access(PAGES, "storage", bytes=4),)
        self.externals = {PAGES: External(None, None, _READ, bytes=4)}
        self.layered: LayeredCasters | None = None
        """What draws meshlets to all layers of a target at once, if mesh shaders do."""
        self._store: Built
        self._kernels: Sequence[Built] = ()

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
                *((("DEPTH_ALONE", 1), ("STEADY_VIEW", 1)) if masked else ()),
            ),
            color=None,
            name="shadow masked" if masked else "shadow",
        )

    def create(self) -> None:
        """Build the pipelines of casters, and the kernels."""
        super().create()
        cleared = () if self.counts_draws else (("CLEARED", 1),)
        described = [ComputeDescription("shadows/store.comp", name="store shadow faces")]
        if self.culls:
            described += [
                ComputeDescription("shadows/lists.comp", name="shadow lists"),
                ComputeDescription("shadows/commands.comp", cleared, name="shadow commands"),
            ]
        self._store, *self._kernels = self._pipelines.get(described)
        if self.counts is not None:
            self.counts.build(self._pipelines)

    def _create_meshlets(self, kinds: Sequence[Variant]) -> None:
        """Build the pipelines with mesh shaders, if these draw casters."""
        if self.layered is not None:
            described = {variant: self.describe(variant) for variant in kinds}
            self.pipelines = [*self.pipelines, *self.layered.create(self._pipelines, described)]

    # --- recording ---

    def record(self, commands: Any) -> None:
        """Record the rounds of this frame. Draws of casters are counted apart from those of the picture."""
        memory = self.memory
        assert memory is not None, "the technique has made it"
        before = dict(commands.work)
        casters = self._casters()
        of_layer = [casters] * max((turn.layers for turn in self.schedule.rounds), default=0)
        if self.lists is not None:
            of_layer = [self._culled(self.lists, casters, layer) for layer in range(len(of_layer))]
        if self.counts is not None and of_layer:
            self.counts.begin(commands, memory)
        for number, turn in enumerate(self.schedule.rounds):
            if self.lists is not None:
                self._cull(commands, memory, self.lists, turn)
            memory.begin_round(commands, turn.size)
            over = self._draw_layers(commands, turn, casters)
            for layer in range(turn.layers):
                groups = [group for group in of_layer[layer] if group is not None]
                if over and not groups:
                    continue
                memory.begin_face(commands, turn.size, layer, over)
                face = np.array([[turn.first + layer, 0, 0, 0]], np.uint32)
                commands.draw_groups(groups, self._draws.binding._replace(pushed=face))
                memory.end_face(commands)
            memory.store(commands, self._store, turn.size, number)
        if self.counts is not None and of_layer:
            self.counts.finish(commands)
        memory.finish(commands)
        for name in ("draws", "draw_calls", "triangles"):
            commands.work[f"shadow_{name}"] = commands.work[name] - before[name]
            commands.work[name] = before[name]

    def _draw_layers(self, commands: Commands, turn: Round, casters: Sequence[DrawGroup | None]) -> bool:
        """Clear the layers of a round and draw meshlets to all of them; return whether mesh shaders do."""
        if self.layered is None or self.lists is None:
            return False
        variants = [self._data.variants[batch.material] for batch in self._draws.solid]
        drawn = [
            None if group is None else (group, variant)
            for group, variant in zip(casters, variants, strict=True)
        ]
        self.layered.draw(commands, self.lists, turn, drawn, self._draws.binding)
        return True

    def _casters(self) -> list[DrawGroup | None]:
        """Return the group of each solid batch, None if it casts no shadows."""
        casters: list[DrawGroup | None] = []
        front = self._settings.shadows.shadow_sides == "front"
        for batch in self._draws.solid:
            casting = self.takes(self._data.variants[batch.material])
            group = self.groups([batch])[0] if casting else None
            casters.append(replace(group, cull=front and group.cull) if group is not None else None)
        return casters

    def _culled(
        self, lists: ShadowLists, casters: Sequence[DrawGroup | None], layer: int
    ) -> list[DrawGroup | None]:
        """Return the groups with the commands that the kernels write for a layer."""
        memory = self.memory
        assert memory is not None, "the technique has made it"
        rows = lists.tables.batches.tolist()
        return [
            None
            if group is None or not lists.by_commands[number]
            else replace(
                group,
                batch=replace(group.batch, first=layer * lists.places + first, count=capacity, triangles=0),
                counted=memory.counted(layer * lists.batches + number),
            )
            for number, (group, (_, first, capacity, _)) in enumerate(zip(casters, rows, strict=True))
        ]

    def _cull(self, commands: Commands, memory: ShadowMemory, lists: ShadowLists, turn: Round) -> None:
        """Record the kernels that write the commands of a round."""
        if not lists.batches:
            return
        memory.begin_lists(commands)
        kernels = self._kernels
        if self.layered is not None:
            self.layered.wait(commands)
            kernels = kernels[: 1 + bool(lists.by_commands.any())]
        constants = np.array(
            [
                [turn.first, 0, lists.places, lists.layers],
                [len(lists.tables.draws), lists.batches, turn.movers, 0],
            ],
            np.uint32,
        )
        for kernel in kernels:
            memory.bind_lists(commands, kernel)
            commands.push(kernel, constants)
            commands.dispatch(lists.batches, turn.layers)
            commands.compute_barrier()
        if self.layered is not None:
            self.layered.cull(commands, lists, turn)
        if self.counts is not None:
            self.counts.add(commands, memory, lists, turn)

    def key(self, slot: int) -> Any:
        """Return the lists of the scene, the rounds, and the tables of casters."""
        return self._draws.key(slot), self.schedule.rounds, id(self.lists)


def read_pages(passes: Collection[Pass]) -> None:
    """Declare in the passes that light surfaces that they load shadows."""
    for gpu_pass in passes:
        gpu_pass.reads = (*gpu_pass.reads, Access(PAGES, "storage"))
