"""The study line-canvas on OpenGL: lines go to mapped memory, one buffer per frame in flight, and one draw reads it."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from backends.gl import api as gl
from backends.gl.resources import bind_buffer
from common.view.camera import View

from ...frames.gl import FrameSlot
from ..drawing_gl import Drawing
from . import CANVAS_BYTES, DRAWN, STUDY, UNIFORM_BYTES, LineWork, Settings, uniforms
from . import fill as fill_canvas
from .canvas import VERTEX, Canvas


class Renderer(Drawing):
    """Lines, collected anew in each frame."""

    study = STUDY
    settings_class: type = Settings
    folder = Path(__file__).parent
    has_depth = True
    fill = staticmethod(fill_canvas)  # yours may stand here

    def create(self) -> None:
        """Make the canvas, and on the GPU room for all that it can hold: once, so that no frame waits for memory."""
        self.canvas = Canvas()
        self._lines = self.per_slot(CANVAS_BYTES, "lines")
        self._uniforms = self.per_slot(UNIFORM_BYTES, "view")
        self._program = self.build(DRAWN)

    def draw(self, slot: FrameSlot, view: View, time: float) -> None:
        """Collect this frame's lines, write them, and draw all in one call; without lines there is none."""
        canvas, lines, frame = self.canvas, self._lines[slot.index], self._uniforms[slot.index]
        canvas.clear()
        self.fill(canvas, self.settings, time)
        self.begin()
        if canvas.count:
            lines.view(VERTEX)[: 2 * canvas.count] = canvas.ends.reshape(-1)
            frame.view(np.float32)[:] = uniforms(self.settings, view, self.size)
            self.bind(self._program)
            bind_buffer(self.device, "uniform", 0, frame)
            bind_buffer(self.device, "storage", 1, lines)
            self.device.fn.glBindVertexArray(self.no_vertices)
            self.device.fn.glDrawArrays(gl.GL_TRIANGLES, 0, 6 * canvas.count)
            self.unbind()
        self.work = LineWork(int(canvas.count > 0), 2 * canvas.count, canvas.count, canvas.dropped)
