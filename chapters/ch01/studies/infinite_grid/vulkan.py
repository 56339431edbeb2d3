"""The study infinite-grid on Vulkan: one triangle over the whole picture, and all geometry in the fragment shader."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from common.view.camera import View

from ...frames.vulkan_commands import Commands
from ...pipelines.description import Binding
from ..drawing_vulkan import Drawing
from . import DRAWN, STUDY, UNIFORM_BYTES, Settings, uniforms

BINDINGS = (Binding(0, "uniform"),)


class Renderer(Drawing):
    """A ruled plane to the horizon."""

    study = STUDY
    settings_class: type = Settings
    folder = Path(__file__).parent
    moves = False

    def create(self) -> None:
        """Make the pipeline; there is nothing to upload."""
        self._uniforms = self.per_slot(UNIFORM_BYTES, "uniform", "rays")
        self._sets = self.sets(BINDINGS, [{0: buffer} for buffer in self._uniforms])
        self._pipeline = self.build(BINDINGS, DRAWN)

    def draw(self, commands: Commands, view: View, time: float) -> None:
        """Draw the triangle. The cost is that of the picture's pixels, however far the plane goes."""
        slot = commands.slot.index
        self._uniforms[slot].view(np.float32)[:] = uniforms(self.settings, view, self.size)
        self.begin(commands)
        self.bind(commands, self._pipeline, self._sets[slot])
        commands.draw_triangle()
        self.end(commands)
        self.work.draws, self.work.triangles = 1, 1
