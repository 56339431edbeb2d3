"""The stage of studies with rays on OpenGL: a kernel over the pixels, and the picture of what it found."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from backends.gl import api as gl
from backends.gl.resources import Buffer, bind_buffer, write_buffer
from common.view.camera import View

from ..frames.gl import FrameSlot
from ..pipelines.description import Described, PipelineDescription
from .seen import COUNTS, EYE, PIXEL, SHADERS, eye_of, work
from .stage_gl import Stage


class RayStage(Stage):
    """A study that traces a ray for each pixel, in compute."""

    moves = False
    number = 0
    """The number of the study's own in the block of the eye."""

    def describe(self) -> Described:
        """Return the kernel that traces."""
        raise NotImplementedError

    def hold(self) -> dict[int, Buffer]:
        """Make what the kernel reads, and return it by binding: those from 3 on."""
        raise NotImplementedError

    def create(self) -> None:
        """Build the programs, and what the study's rays meet."""
        self._eyes = self.per_slot(EYE.itemsize, "eye")
        self._counts = self.empty(4 * COUNTS, "counts")
        self._held = self.hold()
        self._trace, self._show = self.pipelines.get(
            [self.describe(), PipelineDescription(SHADERS, depth=None, name="show")]
        )

    def create_sized(self) -> None:
        """Make room for what is found at each pixel."""
        self._pixels = self.empty(PIXEL.itemsize * self.size[0] * self.size[1], "pixels", sized=True)

    def draw(self, slot: FrameSlot, view: View, time: float) -> None:
        """Trace a ray for each pixel, and show what they found."""
        fn, eye = self.device.fn, self._eyes[slot.index]
        eye.view(EYE)[0] = eye_of(view, self.size, self.number)
        write_buffer(self.device, self._counts, np.zeros(COUNTS, np.uint32))
        bind_buffer(self.device, "uniform", 0, eye)
        for binding, buffer in {1: self._pixels, 2: self._counts, **self._held}.items():
            bind_buffer(self.device, "storage", binding, buffer)
        self.dispatch_over(self._trace, self.size)
        fn.glMemoryBarrier(gl.GL_SHADER_STORAGE_BARRIER_BIT)
        self.begin()
        self.pipelines.bind(self._show, cull=False, front="counter_clockwise")
        fn.glBindVertexArray(self.no_vertices)
        fn.glDrawArrays(gl.GL_TRIANGLES, 0, 3)
        self.work = work(self.size)

    def pixels(self) -> np.ndarray:
        """Return what the last frame found, (H, W) PIXEL."""
        return self.download(self._pixels).view(PIXEL).reshape(self.size[::-1])

    def counted(self) -> NDArray[np.uint32]:
        """Return the counters of the last frame, (COUNTS,)."""
        counts: NDArray[np.uint32] = self.download(self._counts).view(np.uint32)
        return counts
