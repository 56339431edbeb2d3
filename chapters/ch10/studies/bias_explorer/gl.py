"""The study bias-explorer on OpenGL; compare vulkan.py."""

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
    BIASES,
    COUNTS,
    KERNELS,
    MARGIN,
    SHADERS,
    SIDE,
    STUDY,
    TILTS,
    Settings,
    cells,
    defines,
    planes,
    table,
    told,
    work_of,
)


class Renderer(Stage):
    """Tilted planes, each with its map, below five biases."""

    study = STUDY
    settings_class: type = Settings
    moves = False

    def create(self) -> None:
        """Upload the planes; make room for their maps, and for the counts of each frame in flight."""
        macros, width = defines(self.settings), SIDE + 2 * MARGIN
        self._extent = (width, width, len(TILTS))
        self._planes = self.filled(planes(self.settings), "planes")
        self.map = self.empty(4 * width * width * len(TILTS), "maps")
        size = COUNTS.itemsize * len(BIASES) * len(TILTS)
        self._counts = [self.shared(size, f"counts, slot {slot}") for slot in range(self.frame_logic.SLOTS)]
        wanted = [ComputeDescription(kernel, macros, name=kernel) for kernel in KERNELS]
        shown = PipelineDescription(SHADERS, macros, depth=None, name="show")
        self._record, self._count, self._show = self.pipelines.get([*wanted, shown])

    def draw(self, slot: FrameSlot, view: View, time: float) -> None:
        """Record, count and show; a barrier stands before each use of what a kernel stored, and before the first."""
        fn, self.work = self.device.fn, work_of(self.settings)
        for number, buffer in enumerate((self._planes, self.map, self._counts[slot.index])):
            bind_buffer(self.device, "storage", number, buffer)
        fn.glMemoryBarrier(gl.GL_SHADER_STORAGE_BARRIER_BIT)
        self.dispatch_over(self._record, self._extent)
        fn.glMemoryBarrier(gl.GL_SHADER_STORAGE_BARRIER_BIT)
        fn.glUseProgram(self._count.handle)
        fn.glDispatchCompute(len(BIASES) * len(TILTS), 1, 1)
        fn.glMemoryBarrier(gl.GL_CLIENT_MAPPED_BUFFER_BARRIER_BIT)
        self.begin()
        self.pipelines.bind(self._show, cull=False, front="counter_clockwise")
        self.device.push(np.array([*self.size, 0, 0], np.float32))
        fn.glBindVertexArray(self.no_vertices)
        fn.glDrawArrays(gl.GL_TRIANGLES, 0, 3)

    def read_told(self, slot: FrameSlot) -> dict[str, int]:
        """Return what the slot's frame counted, after a wait for it."""
        self.device.make_current()
        self._frames.wait(slot)
        self._last_counts = cells(self._counts[slot.index].mapped.copy())
        return told(self._last_counts)

    def failures(self) -> dict[str, np.ndarray]:
        """Return `acne` and `gap`, (B, T) by bias and tilt, of the frame whose counters were read last."""
        return table(self._last_counts)

    def maps(self) -> np.ndarray:
        """Return the maps of the last frame, (T, SIDE + 2 MARGIN, SIDE + 2 MARGIN) float32."""
        return self.download(self.map).view(np.float32).reshape(*self._extent[::-1])
