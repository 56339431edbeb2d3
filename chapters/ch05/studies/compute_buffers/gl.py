"""The study compute-buffers on OpenGL: buffers bound by number, a dispatch, and `glMemoryBarrier` after it."""

from __future__ import annotations

import numpy as np

from backends.gl import api as gl
from backends.gl.resources import bind_buffer
from common.view.camera import View

from ...frames.frame import SLOTS
from ...frames.gl import FrameSlot
from ...pipelines.compute_description import ComputeDescription
from ...pipelines.description import PipelineDescription
from ..stage_gl import Stage
from . import KERNEL, SHADERS, STUDY, KernelWork, Settings, defines, expected, numbers, push


class Renderer(Stage):
    """A kernel whose numbers are drawn, and compared on the CPU two frames later."""

    study = STUDY
    settings_class: type = Settings
    numbers = staticmethod(numbers)  # a fork may replace it

    def create(self) -> None:
        """Make two buffers for each frame in flight, and the programs."""
        count = self.settings.count
        self._x = self.per_slot(4 * count, "x")
        self._y = [self.shared(4 * count, f"y, slot {slot}") for slot in range(SLOTS)]
        self._kernel, self._bars = self.pipelines.get(
            [
                ComputeDescription(KERNEL, name="kernel"),
                PipelineDescription(SHADERS, defines(self.settings), depth=None, name="bars"),
            ]
        )
        self._push = push(self.settings)
        self._expected: list[np.ndarray | None] = [None] * SLOTS

    def draw(self, slot: FrameSlot, view: View, time: float) -> None:
        """Check the results of the slot's last frame, upload, compute, draw."""
        fn, index = self.device.fn, slot.index
        self.work = KernelWork(draws=1, triangles=1, dispatches=1)
        self._check(index)
        x = self._x[index].view(np.uint32)
        x[:] = self.numbers(self.settings, time)  # mapped memory: this is the upload
        self._expected[index] = expected(x, self.settings)
        for number, buffer in enumerate((self._x[index], self._y[index])):
            bind_buffer(self.device, "storage", number, buffer)
        self.dispatch_over(self._kernel, (self.settings.count,), self._push)  # enough groups for all numbers
        # OpenGL keeps the order of calls for everything but shader stores. The bit names the next read, not the store:
        # here shaders read a buffer.
        fn.glMemoryBarrier(gl.GL_SHADER_STORAGE_BARRIER_BIT)
        self.begin()
        self.pipelines.bind(self._bars, cull=False, front="counter_clockwise")
        fn.glBindVertexArray(self.no_vertices)
        fn.glDrawArrays(gl.GL_TRIANGLES, 0, 3)
        # The CPU reads through a mapping. The fence of the frame, after this barrier, gives the moment.
        fn.glMemoryBarrier(gl.GL_CLIENT_MAPPED_BUFFER_BARRIER_BIT)

    def _check(self, slot: int) -> None:
        """Compare the results of the slot's last frame, which is over: otherwise this frame would not have the slot."""
        true_y, work = self._expected[slot], self.work
        if true_y is not None and isinstance(work, KernelWork):
            work.checked, work.wrong = true_y.size, int((self.downloaded(slot) != true_y).sum())

    def downloaded(self, slot: int) -> np.ndarray:
        """Return the kernel's results of the slot's last frame, (count,) uint32. That frame must be over."""
        return self._y[slot].view(np.uint32)
