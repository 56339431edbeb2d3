"""The study constant-loop on OpenGL: a program for each N, since the constant is a part of the text."""

from __future__ import annotations

import numpy as np

from backends.gl import api as gl
from backends.gl.resources import bind_buffer
from common.view.camera import View

from ...frames.gl import FrameSlot
from ...pipelines.description import PipelineDescription
from ..stage_gl import Stage
from . import SHADERS, STUDY, TAPS, LoopWork, Settings, dispatches, kernel, noise, push


class Renderer(Stage):
    """Means of noise, by a loop of constant length and by one whose length is pushed."""

    study = STUDY
    settings_class: type = Settings
    moves = False

    def create(self) -> None:
        """Upload the noise, make room for all means, and build the programs."""
        self._noise = self.filled(noise(self.settings), "noise")
        self.means = self.empty(4 * self.settings.elements * 2 * len(TAPS), "means")
        kernels = [kernel(self.settings, length) for _, _, length in dispatches()]
        *self.kernels, self._show = self.pipelines.get(
            [*kernels, PipelineDescription(SHADERS, depth=None, name="show")]
        )

    def draw(self, slot: FrameSlot, view: View, time: float) -> None:
        """Sum in each way, one dispatch after another with a time for each, and show."""
        fn, stamps = self.device.fn, slot.timestamps
        bind_buffer(self.device, "storage", 0, self._noise)
        bind_buffer(self.device, "storage", 1, self.means)
        stamps.end()  # each dispatch has a time of its own
        for number, ((name, taps, _), built) in enumerate(zip(dispatches(), self.kernels, strict=True)):
            stamps.begin(name)
            self.dispatch_over(built, (self.settings.elements,), push(self.settings, number, taps))
            stamps.end()
        stamps.begin("show")
        fn.glMemoryBarrier(gl.GL_SHADER_STORAGE_BARRIER_BIT)
        self.begin()
        self.pipelines.bind(self._show, cull=False, front="counter_clockwise")
        self.device.push(np.array([self.settings.elements, *self.size, len(TAPS)], np.uint32))
        fn.glBindVertexArray(self.no_vertices)
        fn.glDrawArrays(gl.GL_TRIANGLES, 0, 3)
        self.work = LoopWork(draws=1, triangles=1, dispatches=len(self.kernels))

    def results(self) -> np.ndarray:
        """Return the means of the last frame, (columns, 2, elements) float32: pushed, then constant."""
        return self.download(self.means).view(np.float32).reshape(len(TAPS), 2, -1)
