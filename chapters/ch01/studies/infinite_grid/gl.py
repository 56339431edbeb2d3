"""The study infinite-grid on OpenGL: one triangle over the whole picture, and all geometry in the fragment shader."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from backends.gl import api as gl
from backends.gl.resources import bind_buffer
from common.view.camera import View

from ...frames.gl import FrameSlot
from ..drawing_gl import Drawing
from . import DRAWN, STUDY, UNIFORM_BYTES, Settings, uniforms


class Renderer(Drawing):
    """A ruled plane to the horizon."""

    study = STUDY
    settings_class: type = Settings
    folder = Path(__file__).parent
    moves = False

    def create(self) -> None:
        """Make the program; there is nothing to upload."""
        self._uniforms = self.per_slot(UNIFORM_BYTES, "rays")
        self._program = self.build(DRAWN)

    def draw(self, slot: FrameSlot, view: View, time: float) -> None:
        """Draw the triangle. The cost is that of the picture's pixels, however far the plane goes."""
        buffer = self._uniforms[slot.index]
        buffer.view(np.float32)[:] = uniforms(self.settings, view, self.size)
        self.begin()
        self.bind(self._program)
        bind_buffer(self.device, "uniform", 0, buffer)
        self.device.fn.glBindVertexArray(self.no_vertices)
        self.device.fn.glDrawArrays(gl.GL_TRIANGLES, 0, 3)
        self.unbind()
        self.work.draws, self.work.triangles = 1, 1
