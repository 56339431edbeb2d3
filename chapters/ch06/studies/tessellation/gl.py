"""The study tessellation on OpenGL: a program of five stages that draws patches, and a query around the draw."""

from __future__ import annotations

import numpy as np

from backends.gl import api as gl
from backends.gl.resources import bind_buffer, write_buffer
from common.view.camera import View

from ...frames.frame import SLOTS
from ...frames.gl import FrameSlot
from ...pipelines.description import PipelineDescription
from ..stage_gl import Stage
from . import STUDY, UNIFORM_BYTES, Settings, defines, record_bytes, shaders, uniforms, work_of

ZERO = np.zeros(4, np.uint32)


class Renderer(Stage):
    """A terrain of patches."""

    study = STUDY
    settings_class: type = Settings
    has_depth = True
    moves = False

    def create(self) -> None:
        """Make the program, the uniforms, and the queries."""
        device, settings = self.device, self.settings
        drawn = PipelineDescription(shaders(settings), defines(settings), name="terrain")
        self._terrain = self.pipelines.get([drawn])[0]
        self._uniforms = self.per_slot(UNIFORM_BYTES, "frame")
        self._record = self.empty(record_bytes(settings), "triangles") if settings.recorded else None
        self._queries = [device.create("query", f"primitives, slot {slot}") for slot in range(SLOTS)]
        for query in self._queries:
            self.keep(query, lambda handle: device.destroy("query", handle))

    def draw(self, slot: FrameSlot, view: View, time: float) -> None:
        """Draw the patches, and let the GPU count the triangles that it makes of them."""
        fn, frame = self.device.fn, self._uniforms[slot.index]
        self.work = work = work_of(self.settings, view)
        frame.view(np.float32)[:] = uniforms(self.settings, view, self.size[0] / self.size[1])
        self.begin()
        self.pipelines.bind(self._terrain, cull=True, front="counter_clockwise")
        bind_buffer(self.device, "uniform", 0, frame)
        if self._record:
            # The stores of the last frame have no order with the upload, nor with the stores of this one.
            fn.glMemoryBarrier(gl.GL_BUFFER_UPDATE_BARRIER_BIT | gl.GL_SHADER_STORAGE_BARRIER_BIT)
            write_buffer(self.device, self._record, ZERO)
            bind_buffer(self.device, "storage", 0, self._record)
        fn.glBindVertexArray(self.no_vertices)
        fn.glPatchParameteri(gl.GL_PATCH_VERTICES, 3)
        fn.glBeginQuery(gl.GL_PRIMITIVES_GENERATED, self._queries[slot.index])
        fn.glDrawArrays(gl.GL_PATCHES, 0, 3 * work.patches)
        fn.glEndQuery(gl.GL_PRIMITIVES_GENERATED)

    def read_told(self, slot: FrameSlot) -> dict[str, int]:
        """Return how many triangles the GPU made in the slot's frame, after a wait for it."""
        self.device.make_current()
        count = gl.ffi.new("GLuint64[1]")
        self.device.fn.glGetQueryObjectui64v(self._queries[slot.index], gl.GL_QUERY_RESULT, count)
        return {"generated": int(count[0])}

    def triangles(self) -> np.ndarray:
        """Return the small triangles of the last frame, (N, 3, 4) float32: corners, and the number of the patch."""
        assert self._record is not None, "open the study with recorded=True"
        words = self.download(self._record).view(np.uint32)
        return words[4 : 4 + 12 * int(words[0])].view(np.float32).reshape(-1, 3, 4)
