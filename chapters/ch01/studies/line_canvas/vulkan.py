"""The study line-canvas on Vulkan: lines go to mapped memory, one buffer per frame in flight, and one draw reads it."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from common.view.camera import View

from ...frames.vulkan_commands import Commands
from ...pipelines.description import Binding
from ..drawing_vulkan import Drawing
from . import CANVAS_BYTES, DRAWN, STUDY, UNIFORM_BYTES, LineWork, Settings, uniforms
from . import fill as fill_canvas
from .canvas import VERTEX, Canvas

BINDINGS = (Binding(0, "uniform"), Binding(1, "storage"))


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
        self._lines = self.per_slot(CANVAS_BYTES, "storage", "lines")
        self._uniforms = self.per_slot(UNIFORM_BYTES, "uniform", "view")
        held = [{0: view, 1: lines} for view, lines in zip(self._uniforms, self._lines, strict=True)]
        self._sets = self.sets(BINDINGS, held)
        self._pipeline = self.build(BINDINGS, DRAWN)

    def draw(self, commands: Commands, view: View, time: float) -> None:
        """Collect this frame's lines, write them, and draw all in one call; without lines there is none."""
        slot, canvas = commands.slot.index, self.canvas
        canvas.clear()
        self.fill(canvas, self.settings, time)
        self.begin(commands)
        if canvas.count:
            self._lines[slot].view(VERTEX)[: 2 * canvas.count] = canvas.ends.reshape(-1)
            self._uniforms[slot].view(np.float32)[:] = uniforms(self.settings, view, self.size)
            self.bind(commands, self._pipeline, self._sets[slot])
            self.device.fn.vkCmdDraw(commands.handle, 6 * canvas.count, 1, 0, 0)
        self.end(commands)
        self.work = LineWork(int(canvas.count > 0), 2 * canvas.count, canvas.count, canvas.dropped)
