"""The study phase-functions on OpenGL: a kernel, and the picture."""

from __future__ import annotations

import numpy as np

from backends.gl import api as gl
from backends.gl.resources import bind_buffer
from common.view.camera import View

from ...frames.gl import FrameSlot
from ...pipelines.compute_description import ComputeDescription
from ...pipelines.description import PipelineDescription
from ..stage_gl import Stage
from . import (
    KERNEL,
    LOBES,
    SHADERS,
    STUDY,
    VALUE_BYTES,
    Settings,
    defines,
    given,
    push,
    told,
    truth,
    work,
)
from .exact import POINTS


class Renderer(Stage):
    """Eight phase functions, and what two forms of them are off."""

    study = STUDY
    settings_class: type = Settings
    moves = False

    def create(self) -> None:
        """Upload directions and truth, make room for values, and build the programs."""
        self._buffers = (
            self.filled(given(), "given"),
            self.empty(VALUE_BYTES, "values"),
            self.filled(truth(self.settings), "truth"),
        )
        self._kernel, self._show = self.pipelines.get(
            [
                ComputeDescription(KERNEL, defines(), name="phases"),
                PipelineDescription(SHADERS, defines(), depth=None, name="show"),
            ]
        )

    def create_sized(self) -> None:
        """Keep what is pushed: no frame changes it."""
        self._pushed = push(self.settings, self.size)

    def draw(self, slot: FrameSlot, view: View, time: float) -> None:
        """Evaluate, and show."""
        fn = self.device.fn
        for binding, buffer in enumerate(self._buffers):
            bind_buffer(self.device, "storage", binding, buffer)
        self.dispatch_over(self._kernel, (POINTS, LOBES), self._pushed)
        fn.glMemoryBarrier(gl.GL_SHADER_STORAGE_BARRIER_BIT)
        self.begin()
        self.pipelines.bind(self._show, cull=False, front="counter_clockwise")
        fn.glBindVertexArray(self.no_vertices)
        fn.glDrawArrays(gl.GL_TRIANGLES, 0, 3)
        self.work = work()

    def read_told(self, slot: FrameSlot) -> dict[str, int]:
        """Return the table of the last frame as counters, after a wait for it."""
        return told(self.settings, self.values())

    def values(self) -> np.ndarray:
        """Return the values of the last frame, (LOBES, POINTS, 4) float32."""
        return self.download(self._buffers[1]).view(np.float32).reshape(-1, POINTS, 4)
