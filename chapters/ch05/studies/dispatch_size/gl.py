"""The study dispatch-size on OpenGL: counters that are cleared, dispatches that add to them, a draw that shows them."""

from __future__ import annotations

import numpy as np

from backends.gl import api as gl
from backends.gl.resources import bind_buffer, write_buffer
from common.view.camera import View

from ...frames.gl import FrameSlot
from ...pipelines.compute_description import ComputeDescription
from ...pipelines.description import PipelineDescription
from ..stage_gl import Stage
from . import KERNEL, SHADERS, STUDY, Settings, check, defines, groups_of, push, room, work_of


class Renderer(Stage):
    """A picture of how often each of its places was reached."""

    study = STUDY
    settings_class: type = Settings
    moves = False

    def create(self) -> None:
        """Make the counters and both programs."""
        settings = self.settings
        check(settings)
        self._groups, self._work = groups_of(settings), work_of(settings)
        self._zeros = np.zeros(room(settings), np.uint32)
        self._counters = self.empty(self._zeros.nbytes, "counters")
        self._kernel, self._show = self.pipelines.get(
            [
                ComputeDescription(KERNEL, defines(settings), name=settings.local),
                PipelineDescription(SHADERS, (("REPEAT", settings.repeat),), depth=None, name="show"),
            ]
        )

    def draw(self, slot: FrameSlot, view: View, time: float) -> None:
        """Clear, count and show."""
        fn = self.device.fn
        self.work = self._work
        fn.glMemoryBarrier(gl.GL_BUFFER_UPDATE_BARRIER_BIT)  # uploads are not ordered after shader stores
        write_buffer(self.device, self._counters, self._zeros)
        bind_buffer(self.device, "storage", 0, self._counters)
        self.device.push(push(self.settings, self.size))
        fn.glUseProgram(self._kernel.handle)
        for _ in range(self.settings.repeat):
            fn.glDispatchCompute(*self._groups, 1)
        fn.glMemoryBarrier(gl.GL_SHADER_STORAGE_BARRIER_BIT)
        self.begin()
        self.pipelines.bind(self._show, cull=False, front="counter_clockwise")
        fn.glBindVertexArray(self.no_vertices)
        fn.glDrawArrays(gl.GL_TRIANGLES, 0, 3)

    def counters(self) -> np.ndarray:
        """Return how often each place was reached in the last frame, (room,) uint32, row after row."""
        return self.download(self._counters).view(np.uint32)
