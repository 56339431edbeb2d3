"""The study random-textures on OpenGL: layers of an array texture, and volumes stacked in one."""

from __future__ import annotations

import numpy as np

from backends.gl import api as gl
from backends.gl.resources import bind_buffer, bind_texture
from common.view.camera import View

from ...frames.gl import FrameSlot
from ...pipelines.description import PipelineDescription
from ..stage_gl import Stage
from . import SHADERS, SHARP, SIDE, STUDY, UNIFORM_BYTES, Settings, defines, grid, textures, volumes


class Renderer(Stage):
    """A grid of triangles, drawn at once, with 32 textures."""

    study = STUDY
    settings_class: type = Settings
    moves = False
    textures = staticmethod(textures)  # yours may stand here
    volumes = staticmethod(volumes)

    def create(self) -> None:
        """Upload the textures, all in two, and make the program."""
        self._sharp = self.sampler(SHARP, "texels")
        self._layers = self.texture(self.textures(), "array", "textures")
        self._stack = self.texture(self.volumes().reshape(-1, SIDE, SIDE, 4), "3d", "volumes")
        self._uniforms = self.per_slot(UNIFORM_BYTES, "picture's size")
        described = PipelineDescription(SHADERS, defines(self.settings), depth=None, name=STUDY.title)
        self._pipeline = self.pipelines.get([described])[0]

    def draw(self, slot: FrameSlot, view: View, time: float) -> None:
        """Draw the grid by one call."""
        cells = grid(self.size)
        self._uniforms[slot.index].view(np.float32)[:3] = *self.size, cells[0]
        self.begin()
        self.pipelines.bind(self._pipeline, cull=False, front="counter_clockwise")
        bind_buffer(self.device, "uniform", 0, self._uniforms[slot.index])
        bind_texture(self.device, 0, self._layers.view, self._sharp)
        bind_texture(self.device, 1, self._stack.view, self._sharp)
        self.device.fn.glBindVertexArray(self.no_vertices)
        self.device.fn.glDrawArrays(gl.GL_TRIANGLES, 0, 6 * cells[0] * cells[1])
        self.work.draws, self.work.triangles = 1, 2 * cells[0] * cells[1]
