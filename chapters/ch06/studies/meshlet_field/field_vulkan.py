"""A study of a field on Vulkan: its buffers, the kernels that select meshlets, and the two passes that draw.

A study adds what stands between the two: how the selected units become draws.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from backends.vulkan import api as vk
from backends.vulkan.barriers import barriers, image_barrier
from backends.vulkan.resources import Buffer
from common.view.camera import View

from ...frames.frame import SLOTS
from ...frames.vulkan import FrameSlot
from ...frames.vulkan_commands import Commands, Rendering
from ...pipelines.compute_description import ComputeDescription
from ...pipelines.description import Built, PipelineDescription
from ...pipelines.vulkan_descriptors import Held
from ..stage_vulkan import Stage
from . import FOLDER, UNIFORM_BYTES, Field, check_bytes, uniforms

STORED = (vk.VK_PIPELINE_STAGE_2_COMPUTE_SHADER_BIT, vk.VK_ACCESS_2_SHADER_STORAGE_WRITE_BIT)
TOTALS = (
    vk.VK_BUFFER_USAGE_STORAGE_BUFFER_BIT
    | vk.VK_BUFFER_USAGE_INDIRECT_BUFFER_BIT
    | vk.VK_BUFFER_USAGE_TRANSFER_DST_BIT
)


class FieldStage(Stage):
    """A study that draws a field, once for colours and once for ids."""

    has_depth = True
    moves = False
    field: Field
    colors: Built
    ids: Built

    def upload(self, field: Field) -> None:
        """Create the buffers of a field."""
        self.field = field
        self.instances = self.filled(field.instances, ["storage"], "instances")
        self.vertices = self.filled(field.vertices, ["storage"], "vertices")
        self.meshlets = self.filled(field.meshlets, ["storage"], "meshlets")
        self.uniforms = self.per_slot(UNIFORM_BYTES, "uniform", "view")
        self.totals = [self._buffer(16, TOTALS, "readback", f"totals, slot {slot}") for slot in range(SLOTS)]

    def make_kernels(self, defines: tuple[tuple[str, int], ...]) -> None:
        """Build the kernels that select units, and create what they write."""
        check_bytes(8 * self.field.units, "places", self.capabilities.limits["maxStorageBufferRange"])
        self.places = self.empty(8 * self.field.units, ["storage"], "places")
        self.sums = self.empty(8 * len(self.field.instances) + 8, ["storage"], "sums")
        files = ("select.comp", "scan.comp")
        self._select, self._scan = self.pipelines.get(
            [ComputeDescription(f"{FOLDER}/{file}", defines, name=file) for file in files]
        )
        tables = {1: self.instances, 2: self.meshlets, 3: self.places, 4: self.sums}
        self._selecting = self.sets(self._select, tables, {0: self.uniforms})
        self._scanning = self.sets(self._scan, {0: self.sums}, {1: self.totals})

    def sets(
        self, pipeline: Built, held: Mapping[int, Held], in_slot: Mapping[int, list[Buffer]]
    ) -> list[Any]:
        """Return a descriptor set for each slot; `in_slot` are buffers that exist once for each."""
        sets = []
        for slot in range(SLOTS):
            bound = dict(held) | {number: buffers[slot] for number, buffers in in_slot.items()}
            sets.append(self.set_of(pipeline, bound, f"{pipeline.described.name}, slot {slot}"))
        return sets

    def make_draws(self, first: tuple[str, ...], defines: tuple[tuple[str, int], ...]) -> None:
        """Build the pipelines of both passes, whose stages before the fragments are `first`."""
        colors, ids = (*first, f"{FOLDER}/mesh.frag"), (*first, f"{FOLDER}/ids.frag")
        self.colors, self.ids = self.pipelines.get(
            [
                PipelineDescription(colors, (*defines, ("COLORS", 1)), color="rgba8", name="colours"),
                PipelineDescription(ids, (*defines, ("COLORS", 0)), color="r32ui", depth="equal", name="ids"),
            ]
        )

    def create_sized(self) -> None:
        """Make the target of ids, if it is asked for. Its pass tests against the depth of the first pass."""
        self._with_ids = "instance_id" in self.outputs
        if self._with_ids:
            target, depth = self.target("ids", "r32ui", "instance_id"), self.depth
            assert depth is not None
            begins = self._start(target, "color")
            self._to_ids = barriers(begins, image_barrier(depth.handle, depth.aspect, "depth", "depth"))
            self._second = Rendering(self.size, target, depth, (0, 0, 0, 0))

    def write_view(self, slot: int, view: View, turned: float) -> None:
        """Write the uniforms of a frame."""
        self.uniforms[slot].view(np.float32)[:] = uniforms(view, self.size, turned)

    def select(self, commands: Commands) -> None:
        """Select the units of the frame: their places, the sums of instances, and the totals."""
        slot = commands.slot.index
        commands.begin_label("select")
        commands.bind_compute(self._select)
        commands.bind_compute_set(self._select, 0, self._selecting[slot])
        commands.dispatch(len(self.field.instances))
        commands.end_label()
        commands.compute_barrier()
        commands.begin_label("scan")
        commands.bind_compute(self._scan)
        commands.bind_compute_set(self._scan, 0, self._scanning[slot])
        commands.dispatch(1)
        commands.end_label()

    def draw_passes(self, commands: Commands) -> None:
        """Draw colours and depth, and then the ids. They are timed apart: what is before has the study's name."""
        self._profiler.end(commands.slot)
        self._profiler.begin(commands.slot, "draws")
        commands.begin_label("draws")
        self.begin(commands)
        self.draw_units(commands, self.colors)
        self.end(commands)
        if self._with_ids:
            commands.barrier(self._to_ids)
            commands.begin_rendering(self._second)
            self.draw_units(commands, self.ids)
            commands.end_rendering()
        commands.end_label()

    def draw_units(self, commands: Commands, pipeline: Built) -> None:
        """Draw what was selected, with the pipeline of a pass."""
        raise NotImplementedError

    def read_told(self, slot: FrameSlot) -> dict[str, int]:
        """Return the totals that the GPU wrote in the slot's frame, after a wait for it."""
        self._frames.wait(slot)
        buffer = self.totals[slot.index]
        self.device.memory.invalidate(buffer.allocation)
        return self.told(*buffer.view(np.uint32)[:2].tolist())

    def told(self, units: int, triangles: int) -> dict[str, int]:
        """Return the counters of these totals by name."""
        raise NotImplementedError
