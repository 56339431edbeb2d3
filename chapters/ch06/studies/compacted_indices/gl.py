"""The study compacted-indices on OpenGL: the same kernels, and memory barriers for commands and indices."""

from __future__ import annotations

import numpy as np

from backends.gl import api as gl
from backends.gl.draws import create_vertex_array
from backends.gl.resources import bind_buffer
from backends.gl.targets import begin
from common.view.camera import View

from ...frames.frame import SLOTS
from ...frames.gl import FrameSlot
from ...pipelines.compute_description import ComputeDescription
from ...pipelines.description import Built, PipelineDescription
from ...scene.draw_lists import COMMAND
from ..meshlet_field import FOLDER, UNIFORM_BYTES, check_bytes, defines, field_of, uniforms
from ..stage_gl import Stage
from . import SHADERS, STUDY, WAYS, WRITE, Settings, counters, most_commands, plan_of

READ = gl.GL_COMMAND_BARRIER_BIT | gl.GL_ELEMENT_ARRAY_BARRIER_BIT | gl.GL_CLIENT_MAPPED_BUFFER_BARRIER_BIT
KERNELS = (f"{FOLDER}/select.comp", f"{FOLDER}/scan.comp", WRITE)


class Renderer(Stage):
    """A field whose meshlets are drawn from commands."""

    study = STUDY
    settings_class: type = Settings
    has_depth = True
    moves = False

    def create(self) -> None:
        """Upload the field, and make the kernels and what they write."""
        settings, limit = self.settings, self.capabilities.limits["maxStorageBufferRange"]
        self.plan = plan_of(self.capabilities, self.without)
        self.field = field = field_of(settings.instances)
        self._most = most_commands(field, settings.way)
        check_bytes(COMMAND.itemsize * self._most, "commands", limit)
        macros = defines(settings.culling, settings.group, WAYS.index(settings.way))
        self._kernels = self.pipelines.get([ComputeDescription(file, macros, name=file) for file in KERNELS])
        shaders = [(*SHADERS, f"{FOLDER}/{file}") for file in ("mesh.frag", "ids.frag")]
        self._colors = self.pipelines.get([PipelineDescription(shaders[0], name="colours")])[0]
        self._ids = self.pipelines.get([PipelineDescription(shaders[1], depth="equal", name="ids")])[0]
        self._uniforms = self.per_slot(UNIFORM_BYTES, "view")
        self._instances = self.filled(field.instances, "instances")
        self._vertices = self.filled(field.vertices, "vertices")
        self._meshlets = self.filled(field.meshlets, "meshlets")
        self.source = self.drawn_indices = self.filled(field.indices, "indices")
        if settings.way == "indices":
            check_bytes(4 * field.most_indices, "compacted indices", limit)
            self.drawn_indices = self.empty(4 * field.most_indices, "compacted")
        self._places = self.empty(8 * field.units, "places")
        self._sums = self.empty(8 * len(field.instances) + 8, "sums")
        self.written = self.empty(COMMAND.itemsize * self._most, "commands")
        self._totals = [self.shared(16, f"totals, slot {slot}") for slot in range(SLOTS)]
        array = create_vertex_array(self.device, (), None, self.drawn_indices, "indices")
        self._array = self.keep(array, lambda handle: self.device.destroy("vertex array", handle))

    def create_sized(self) -> None:
        """Make the target of ids, if it is asked for. Its pass tests against the depth of the first pass."""
        self._with_ids = "instance_id" in self.outputs
        if self._with_ids:
            self._id_framebuffer = self.framebuffer_of(
                self.target("ids", "r32ui", "instance_id"), self.depth, "ids"
            )

    def draw(self, slot: FrameSlot, view: View, time: float) -> None:
        """Select meshlets, write what draws them, and draw, once for colours and once for ids."""
        uniform = self._uniforms[slot.index]
        uniform.view(np.float32)[:] = uniforms(view, self.size, self.settings.turned)
        bind_buffer(self.device, "uniform", 0, uniform)
        self._compute(slot.index)
        slot.timestamps.end()  # the kernels have the study's name
        slot.timestamps.begin("draws")
        self.begin()
        self._draw_units(slot.index, self._colors)
        if self._with_ids:
            begin(self.device, self._id_framebuffer, ((0, 0, 0, 0),))
            self._draw_units(slot.index, self._ids)

    def _compute(self, slot: int) -> None:
        select, scan, write = self._kernels
        per_instance = (len(self.field.instances) * select.group[0],)
        tables = [self._instances, self._meshlets, self._places, self._sums]
        bound = (
            tables,
            [self._sums, self._totals[slot]],
            [*tables, self.written, self.source, self.drawn_indices],
        )
        # The kernels write over what earlier draws have read.
        self.device.fn.glMemoryBarrier(READ | gl.GL_SHADER_STORAGE_BARRIER_BIT)
        for kernel, buffers, extent in zip(
            (select, scan, write), bound, (per_instance, (256,), per_instance), strict=True
        ):
            for number, buffer in enumerate(buffers):
                bind_buffer(self.device, "storage", number, buffer)
            self.dispatch_over(kernel, extent)
            self.device.fn.glMemoryBarrier(READ | gl.GL_SHADER_STORAGE_BARRIER_BIT)

    def _draw_units(self, slot: int, pipeline: Built) -> None:
        fn, context = self.device.fn, self.device
        self.pipelines.bind(pipeline, cull=True, front="counter_clockwise")
        bind_buffer(context, "storage", 0, self._instances)
        bind_buffer(context, "storage", 1, self._vertices)
        fn.glBindVertexArray(self._array)
        fn.glBindBuffer(gl.GL_DRAW_INDIRECT_BUFFER, self.written.handle)
        fn.glBindBuffer(gl.GL_PARAMETER_BUFFER, self._totals[slot].handle)
        kind = (gl.GL_TRIANGLES, gl.GL_UNSIGNED_INT)
        fn.glMultiDrawElementsIndirectCountARB(*kind, gl.ffi.NULL, 0, self._most, COMMAND.itemsize)
        # Mesa's draws without a count read it, too, while such a buffer is bound.
        fn.glBindBuffer(gl.GL_PARAMETER_BUFFER, 0)
        self.work.draws += 1

    def read_told(self, slot: FrameSlot) -> dict[str, int]:
        """Return the counters that the GPU wrote in the slot's frame, after a wait for it."""
        self.device.make_current()
        self._frames.wait(slot)
        return counters(self.settings.way, *self._totals[slot.index].view(np.uint32)[:2].tolist())

    def lists_after(self) -> tuple[np.ndarray, np.ndarray]:
        """Return the commands of the last frame and the indices that they draw, both with what lies behind the last."""
        return self.download(self.written).view(COMMAND), self.download(self.drawn_indices).view(np.uint32)
