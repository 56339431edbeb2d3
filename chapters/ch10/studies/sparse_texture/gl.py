"""The study sparse-texture on OpenGL: a pool of pages and a table, since sparse textures are an extension."""

from __future__ import annotations

import numpy as np

from backends.gl import api as gl
from backends.gl.resources import bind_buffer
from common.view.camera import View

from ...frames.gl import FrameSlot
from ...pipelines.compute_description import ComputeDescription
from ...pipelines.description import PipelineDescription
from ..stage_gl import Stage
from . import FILL, KERNELS, PAGE_BYTES, SHADERS, STUDY, TILE, TILES, Residency, Settings, defines, told


class Renderer(Stage):
    """A texture whose tiles have memory around a moving spot."""

    study = STUDY
    settings_class: type = Settings
    sparse = False

    def create(self) -> None:
        """Make the pool, and what the CPU writes for each frame."""
        self.residency = Residency(self.settings)
        self._tiles = self.per_slot(8 * TILES, "tiles")
        self._fills = self.per_slot(FILL.itemsize * TILES, "pages to write")
        self._counts = [self.shared(8 * TILES, f"counts, slot {n}") for n in range(self.frame_logic.SLOTS)]
        self._pool = self.empty(self.settings.pages * PAGE_BYTES, "pool")
        macros = defines(self.sparse)
        wanted = [ComputeDescription(kernel, macros, name=kernel) for kernel in KERNELS]
        shown = PipelineDescription(SHADERS, macros, depth=None, name="show")
        self._fill, self._count, self._show = self.pipelines.get([*wanted, shown])

    def draw(self, slot: FrameSlot, view: View, time: float) -> None:
        """Write the pages that are wanted at this time, count, and show."""
        fn, tiles, fills_at = self.device.fn, self._tiles[slot.index], self._fills[slot.index]
        changed, fills = self.residency.update(time)
        self.work = self.residency.work_of(changed, fills)
        tiles.view(np.uint32)[:] = self.residency.table().reshape(-1)
        bind_buffer(self.device, "storage", 0, tiles)
        bind_buffer(self.device, "storage", 1, self._pool)
        fn.glMemoryBarrier(gl.GL_SHADER_STORAGE_BARRIER_BIT)
        if len(fills):
            fills_at.view(FILL)[: len(fills)] = fills
            bind_buffer(self.device, "storage", 2, fills_at)
            self.dispatch_over(self._fill, (TILE, TILE, len(fills)))
            fn.glMemoryBarrier(gl.GL_SHADER_STORAGE_BARRIER_BIT)
        bind_buffer(self.device, "storage", 2, self._counts[slot.index])
        fn.glUseProgram(self._count.handle)
        fn.glDispatchCompute(TILES, 1, 1)
        fn.glMemoryBarrier(gl.GL_CLIENT_MAPPED_BUFFER_BARRIER_BIT)
        self.begin()
        self.pipelines.bind(self._show, cull=False, front="counter_clockwise")
        self.device.push(np.array([*self.size, 0, 0], np.float32))
        fn.glBindVertexArray(self.no_vertices)
        fn.glDrawArrays(gl.GL_TRIANGLES, 0, 3)

    def counted(self, slot: FrameSlot) -> np.ndarray:
        """Return (TILES, 2) of the slot's frame: texels of each tile that have memory, and those that are wrong."""
        self.device.make_current()
        self._frames.wait(slot)
        return self._counts[slot.index].view(np.uint32).reshape(TILES, 2).copy()

    def read_told(self, slot: FrameSlot) -> dict[str, int]:
        """Return the sums of what the slot's frame counted."""
        self.last_counts = self.counted(slot)
        return told(self.last_counts)
