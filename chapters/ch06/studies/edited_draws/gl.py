"""The study edited-draws on OpenGL: a kernel writes commands, and `GL_COMMAND_BARRIER_BIT` shows them to the draws."""

from __future__ import annotations

import numpy as np

from backends.gl import api as gl
from backends.gl.draws import Stream, create_vertex_array
from backends.gl.resources import bind_buffer
from backends.gl.targets import begin
from common.view.camera import View

from ...frames.frame import SLOTS
from ...frames.gl import FrameSlot
from ...pipelines.description import Built, PipelineDescription
from ...scene.draw_lists import COMMAND
from ..stage_gl import Stage
from . import (
    ID_SHADERS,
    SHADERS,
    STUDY,
    UNIFORM_BYTES,
    DrawWork,
    Settings,
    circle,
    defines,
    kernel_of,
    matrices,
    plan_of,
    push,
    way_of,
)
from .records import MATERIALS, inside, scene_of, triangles_of
from .shapes import all_meshes


class Renderer(Stage):
    """Many meshes, of which those inside a circle are drawn."""

    study = STUDY
    settings_class: type = Settings
    has_depth = True

    def create(self) -> None:
        """Upload meshes and records, and make the programs and the buffers that the kernel fills."""
        settings, meshes = self.settings, all_meshes()
        self.plan = plan_of(self.capabilities, self.without)
        self.way = way_of(settings, self.plan)
        self.drawn = scene_of(settings.objects, meshes)
        self._vertices = self.filled(np.concatenate([meshes.positions, meshes.normals]), "vertices")
        indices = self.filled(meshes.indices, "indices")
        fetched = settings.feed == "attributes"
        streams = [Stream(0, 3, 0), Stream(1, 3, meshes.positions.nbytes)] if fetched else []
        array = create_vertex_array(self.device, streams, self._vertices, indices, "meshes")
        self._array = self.keep(array, lambda handle: self.device.destroy("vertex array", handle))
        self._objects = self.filled(self.drawn.objects, "objects")
        self._materials = self.filled(MATERIALS[: settings.materials], "materials")
        self._uniforms = self.per_slot(UNIFORM_BYTES, "matrices")
        self._commands = self.filled(self.drawn.commands, "commands")
        self.edited = self.empty(self.drawn.commands.nbytes, "edited commands")
        self.draw_counts = [self.shared(8, f"counts, slot {slot}") for slot in range(SLOTS)]
        parts = [defines(settings, open_mesh) for open_mesh in (False, True)]
        self._colors = self.pipelines.get(
            [PipelineDescription(SHADERS, part, name="colours") for part in parts]
        )
        self._ids = self.pipelines.get(
            [PipelineDescription(ID_SHADERS, part, depth="equal", name="ids") for part in parts]
        )
        if self.way != "separate":
            self._kernel = self.pipelines.get([kernel_of(self.way)])[0]

    def create_sized(self) -> None:
        """Make the target of ids, if it is asked for. Its pass tests against the depth of the first pass."""
        self._with_ids = "instance_id" in self.outputs
        if self._with_ids:
            target = self.target("ids", "r32ui", "instance_id")
            self._id_framebuffer = self.framebuffer_of(target, self.depth, "ids")

    def draw(self, slot: FrameSlot, view: View, time: float) -> None:
        """Let the kernel edit the commands, and draw both parts, once for colours and once for ids."""
        index, way = slot.index, self.way
        self.work = work = DrawWork()
        self._uniforms[index].view(np.float32)[:] = matrices(view, self.size[0] / self.size[1])
        if way != "separate":
            self._edit(index, time)
        self.begin()
        self._draw_parts(index, self._colors, time, work)
        if self._with_ids:
            begin(self.device, self._id_framebuffer, ((0, 0, 0, 0),))
            self._draw_parts(index, self._ids, time, work)

    def _edit(self, slot: int, time: float) -> None:
        fn, bound = self.device.fn, [self._commands, self._objects, self.edited]
        for number, buffer in enumerate([*bound, self.draw_counts[slot]]):
            bind_buffer(self.device, "storage", number, buffer)
        # On both sides: the kernel waits for earlier reads of commands, and later reads see its stores.
        fn.glMemoryBarrier(gl.GL_COMMAND_BARRIER_BIT)
        groups = 2 if self.way == "count" else -(-self.settings.objects // 64)
        extent = (groups * self._kernel.group[0],)
        self.dispatch_over(self._kernel, extent, push(self.settings, self.drawn.parts, time))
        # The CPU reads the counts through a mapping; the fence of the frame gives the moment.
        fn.glMemoryBarrier(gl.GL_COMMAND_BARRIER_BIT | gl.GL_CLIENT_MAPPED_BUFFER_BARRIER_BIT)

    def _draw_parts(self, slot: int, pipelines: list[Built], time: float, work: DrawWork) -> None:
        fn, context = self.device.fn, self.device
        bind_buffer(context, "uniform", 0, self._uniforms[slot])
        for number, buffer in enumerate((self._objects, self._materials, self._vertices)):
            bind_buffer(context, "storage", number, buffer)
        fn.glBindVertexArray(self._array)
        fn.glBindBuffer(gl.GL_DRAW_INDIRECT_BUFFER, self.edited.handle)
        kind, stride = (gl.GL_TRIANGLES, gl.GL_UNSIGNED_INT), COMMAND.itemsize
        for part, ((first, count), pipeline) in enumerate(zip(self.drawn.parts, pipelines, strict=True)):
            self.pipelines.bind(pipeline, cull=part == 0, front="counter_clockwise")
            place = gl.ffi.cast("void *", first * stride)
            if self.way == "separate":
                visible = inside(self.drawn.objects, circle(self.settings, time))[first : first + count]
                kept = self.drawn.commands[first : first + count][visible]
                for indices, instances, first_index, *bases in kept.tolist():
                    fn.glDrawElementsInstancedBaseVertexBaseInstance(
                        kind[0], indices, kind[1], gl.ffi.cast("void *", 4 * first_index), instances, *bases
                    )
                work.add(len(kept), triangles_of(kept), len(kept))
                continue
            if self.way == "count":
                fn.glBindBuffer(gl.GL_PARAMETER_BUFFER, self.draw_counts[slot].handle)
                fn.glMultiDrawElementsIndirectCountARB(*kind, place, 4 * part, count, stride)
                # Mesa's draws without a count read it, too, while such a buffer is bound.
                fn.glBindBuffer(gl.GL_PARAMETER_BUFFER, 0)
            else:
                fn.glMultiDrawElementsIndirect(*kind, place, count, stride)
            work.add(count, self.drawn.triangles[part], 1)

    def read_told(self, slot: FrameSlot) -> dict[str, int]:
        """Return how many draws the count buffer asked for in the slot's frame, after a wait for it."""
        if self.way != "count":
            return {}
        self.device.make_current()
        self._frames.wait(slot)
        return {"counted": int(self.draw_counts[slot.index].view(np.uint32).sum())}

    def commands_after(self) -> np.ndarray:
        """Return the commands that the last frame drew, (D,) COMMAND."""
        return self.download(self.edited).view(COMMAND)
