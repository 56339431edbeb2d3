"""The study far-march on OpenGL: the grid, the fog of pixels, and the picture."""

from __future__ import annotations

import numpy as np

from backends.gl import api as gl
from backends.gl.resources import bind_buffer
from common.view.camera import View

from ...frames.gl import FrameSlot
from ...pipelines.compute_description import ComputeDescription
from ...pipelines.description import PipelineDescription
from ..stage_gl import Stage
from . import BLOCK_BYTES, KERNELS, SHADERS, STUDY, Settings, block, froxel_bytes, work


class Renderer(Stage):
    """A plain in fog that goes on behind its grid."""

    study = STUDY
    settings_class: type = Settings
    moves = False

    def create(self) -> None:
        """Make the grid and build the programs."""
        self._blocks = self.per_slot(BLOCK_BYTES, "air")
        self._grid = self.empty(froxel_bytes(self.settings), "grid")
        self._fill, self._march, self._show = self.pipelines.get(
            [
                *(ComputeDescription(kernel, name=kernel) for kernel in KERNELS),
                PipelineDescription(SHADERS, depth=None, name="show"),
            ]
        )

    def create_sized(self) -> None:
        """Make room for the fog of each pixel."""
        self._fog = self.empty(16 * self.size[0] * self.size[1], "fog", sized=True)

    def draw(self, slot: FrameSlot, view: View, time: float) -> None:
        """Fill the grid, look up and march, and show."""
        fn, knobs, air = self.device.fn, self.settings, self._blocks[slot.index]
        air.view(np.float32)[:] = block(knobs, view, self.size)
        bind_buffer(self.device, "uniform", 0, air)
        bind_buffer(self.device, "storage", 1, self._grid)
        bind_buffer(self.device, "storage", 2, self._fog)
        for kernel, extent in ((self._fill, (knobs.columns, knobs.rows)), (self._march, self.size)):
            fn.glMemoryBarrier(gl.GL_SHADER_STORAGE_BARRIER_BIT)
            self.dispatch_over(kernel, extent)
        fn.glMemoryBarrier(gl.GL_SHADER_STORAGE_BARRIER_BIT)
        self.begin()
        self.pipelines.bind(self._show, cull=False, front="counter_clockwise")
        fn.glBindVertexArray(self.no_vertices)
        fn.glDrawArrays(gl.GL_TRIANGLES, 0, 3)
        self.work = work(knobs, self.size)

    def fog(self) -> np.ndarray:
        """Return light and transmittance between the eye and each pixel of the last frame, (H, W, 4) float32."""
        return self.download(self._fog).view(np.float32).reshape(*self.size[::-1], 4)
