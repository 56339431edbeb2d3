"""The study types-16bit on OpenGL, whose buffers have no 16-bit types: words of 32 bits, packed or not."""

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
    SHADERS,
    STUDY,
    NumberWork,
    Settings,
    bytes_of,
    decoded,
    defines,
    encoded,
    halves,
    integers,
    pairs_of,
    plan_of,
    push,
    way_of,
)


class Renderer(Stage):
    """A kernel with numbers of 16 bits."""

    study = STUDY
    settings_class: type = Settings
    integers = staticmethod(integers)  # a fork may replace both
    halves = staticmethod(halves)

    def create(self) -> None:
        """Upload the numbers, and make room for the results."""
        settings = self.settings
        self.plan = plan_of(self.capabilities, self.without)
        self.way = way = way_of(settings, self.plan)
        x, h = (encoded(numbers(settings), way) for numbers in (self.integers, self.halves))
        self.inputs = [self.filled(x, "x"), self.filled(h, "h")]
        self.written = [self.empty(bytes_of(settings, way), name) for name in ("y", "g")]
        macros = defines(settings, way)
        self._kernel, self._show = self.pipelines.get(
            [
                ComputeDescription(KERNEL, macros, name=way),
                PipelineDescription(SHADERS, macros, depth=None, name="show"),
            ]
        )

    def draw(self, slot: FrameSlot, view: View, time: float) -> None:
        """Compute and show."""
        fn, buffers, constants = self.device.fn, [*self.inputs, *self.written], push(self.settings, time)
        self.work = NumberWork(1, 1, 1, sum(buffer.size for buffer in buffers))
        for number, buffer in enumerate(buffers):
            bind_buffer(self.device, "storage", number, buffer)
        # On both sides: the kernel waits for the draw of the last frame, and the draw sees the stores.
        fn.glMemoryBarrier(gl.GL_SHADER_STORAGE_BARRIER_BIT)
        self.dispatch_over(self._kernel, (pairs_of(self.settings),), constants)
        fn.glMemoryBarrier(gl.GL_SHADER_STORAGE_BARRIER_BIT)
        self.begin()
        self.pipelines.bind(self._show, cull=False, front="counter_clockwise")
        fn.glBindVertexArray(self.no_vertices)
        fn.glDrawArrays(gl.GL_TRIANGLES, 0, 3)

    def results(self) -> tuple[np.ndarray, np.ndarray]:
        """Return y (count,) int16 and g (count,) float16 of the last frame."""
        y, g = (self.download(buffer) for buffer in self.written)
        return decoded(y, np.int16, self.settings, self.way), decoded(g, np.float16, self.settings, self.way)
