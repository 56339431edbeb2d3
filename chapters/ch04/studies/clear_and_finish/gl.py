"""The study clear-and-finish on OpenGL: clearing is a call, and finishing is to let go of the framebuffer."""

from __future__ import annotations

import numpy as np

from backends.gl import api as gl
from backends.gl.resources import bind_buffer
from backends.gl.targets import begin
from common.view.camera import View

from ...frames.gl import FrameSlot
from ...pipelines.description import PipelineDescription
from ..stage_gl import Stage
from . import CLEAR_COLOR, CLEAR_DEPTH, PANELS, SHADERS, STUDY, UNIFORM_BYTES, Settings, uniforms


class Renderer(Stage):
    """Three layers, one behind the other."""

    study = STUDY
    settings_class: type = Settings
    has_depth = True

    def create(self) -> None:
        """Make what the panels are drawn with."""
        described = PipelineDescription(SHADERS, depth="write", name="panels")
        self._pipeline = self.pipelines.get([described])[0]
        self._uniforms = self.per_slot(UNIFORM_BYTES, "place of the panels")

    def draw(self, slot: FrameSlot, view: View, time: float) -> None:
        """Do one layer after the other."""
        self._uniforms[slot.index].view(np.float32)[:] = uniforms(time)
        with self.device.label("clear"):
            # Masks decide what a clear may write, and an earlier draw may have changed them; `begin` resets them.
            begin(self.device, self.framebuffer, (CLEAR_COLOR,), CLEAR_DEPTH)
        if self.settings.panels:
            with self.device.label("panels"):
                self.panels(slot)
        with self.device.label("finish"):
            self.finish()

    def panels(self, slot: FrameSlot) -> None:
        """Draw on what is there: to the framebuffer that the clear has bound, and after it, as calls are ordered."""
        fn = self.device.fn
        self.pipelines.bind(self._pipeline, cull=False, front="counter_clockwise")
        bind_buffer(self.device, "uniform", 0, self._uniforms[slot.index])
        fn.glBindVertexArray(self.no_vertices)
        fn.glDrawArraysInstanced(gl.GL_TRIANGLES, 0, 6, PANELS)
        self.work.draws, self.work.triangles = 1, 2 * PANELS

    def finish(self) -> None:
        """Leave the picture complete for reading. Layouts and waiting are the driver's.

        What a program must not do is read an image while a draw writes it. So it is written no more from here on.
        """
        self.device.fn.glBindFramebuffer(gl.GL_FRAMEBUFFER, 0)
