"""The study fragment-order on OpenGL: a counter that is reset, a draw that writes a list, and one that reads it."""

from __future__ import annotations

import numpy as np

from backends.gl import api as gl
from backends.gl.resources import bind_buffer, write_buffer
from common.view.camera import View

from ...frames.gl import FrameSlot
from ...pipelines.description import PipelineDescription
from ..stage_gl import Stage
from . import COVER, POINTS, STUDY, VERTICES, OrderWork, Settings, places, push, shown

ZERO = np.zeros(1, np.uint32)


class Renderer(Stage):
    """The fragments of one draw, in the order in which they came."""

    study = STUDY
    settings_class: type = Settings

    def create(self) -> None:
        """Make both programs and the counter."""
        quad = (("QUAD", int(self.settings.shape == "quad")),)
        self._cover, self._points = self.pipelines.get(
            [
                PipelineDescription(COVER, quad, depth=None, name="number"),
                PipelineDescription(POINTS, depth=None, name="points"),
            ]
        )
        self._count = self.empty(4, "counter")

    def create_sized(self) -> None:
        """Make the list, with room for each pixel."""
        self.capacity = self.size[0] * self.size[1]
        self._nodes = self.empty(4 * self.capacity, "list of fragments", sized=True)

    def draw(self, slot: FrameSlot, view: View, time: float) -> None:
        """Reset the counter, let the fragments of one draw number themselves, and draw the first of them."""
        fn, count = self.device.fn, shown(self.settings, time, self.capacity)
        vertices = VERTICES[self.settings.shape]
        self.work = OrderWork(draws=1 + bool(count), triangles=vertices // 3 + count, points=count)
        # Shader stores have no order with uploads, nor with later stores.
        fn.glMemoryBarrier(gl.GL_BUFFER_UPDATE_BARRIER_BIT | gl.GL_SHADER_STORAGE_BARRIER_BIT)
        write_buffer(self.device, self._count, ZERO)
        self.begin()
        fn.glBindVertexArray(self.no_vertices)
        self.pipelines.bind(self._cover, cull=False, front="counter_clockwise")
        bind_buffer(self.device, "storage", 0, self._nodes)
        bind_buffer(self.device, "storage", 1, self._count)
        self.device.push(push(self.size, self.capacity))
        fn.glDrawArrays(gl.GL_TRIANGLES, 0, vertices)
        if count:
            fn.glMemoryBarrier(gl.GL_SHADER_STORAGE_BARRIER_BIT)
            self.pipelines.bind(self._points, cull=False, front="counter_clockwise")
            fn.glDrawArrays(gl.GL_TRIANGLES, 0, 3 * count)

    def order(self) -> tuple[int, np.ndarray]:
        """Return how many numbers the last frame gave out, and (N, 2) the pixels that got them: x and y."""
        count = int(self.download(self._count).view(np.uint32)[0])
        return count, places(self.download(self._nodes).view(np.uint32))
