"""The study wireframe on OpenGL: how triangles are filled and how far they are moved are two switches."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from backends.gl import api as gl
from backends.gl.resources import bind_buffer
from common.scene import Scene
from common.scene.primitive import alone, primitive_of
from common.view.camera import View

from ...frames.gl import FrameSlot
from ..drawing_gl import Drawing
from . import STUDY, UNIFORM_BYTES, Settings, corners_of, draws_of, plan_of, uniforms


class Renderer(Drawing):
    """One object of a scene, turning, with the edges of its triangles."""

    study = STUDY
    settings_class: type = Settings
    folder = Path(__file__).parent
    has_depth = True

    def choose(self, scene: Scene) -> Scene:
        """Return the one object that is drawn."""
        return alone(scene, self.settings.instance)

    def create(self) -> None:
        """Upload all corners, and make one program for each draw."""
        self.plan = plan_of(self.plan, self.capabilities, self.without, self.settings)
        self._corners = corners_of(primitive_of(self.scene))
        vertices = self.filled(self._corners, "corners")
        self._uniforms = self.per_slot(UNIFORM_BYTES, "uniforms")
        draws = draws_of(self.plan.native("wireframe"), self.settings)
        self._programs_in_order = [self.build(described) for described in draws]
        self._vertices = self.vertex_array(draws[0], vertices, None)

    def draw(self, slot: FrameSlot, view: View, time: float) -> None:
        """Draw the same triangles once for each program: filled, and then their outlines."""
        fn, buffer = self.device.fn, self._uniforms[slot.index]
        aspect = self.size[0] / self.size[1]
        buffer.view(np.float32)[:] = uniforms(self.scene, self.settings, view, time, aspect)
        self.begin()
        bind_buffer(self.device, "uniform", 0, buffer)
        fn.glBindVertexArray(self._vertices)
        for built in self._programs_in_order:
            self.bind(built)
            fn.glDrawArrays(gl.GL_TRIANGLES, 0, len(self._corners))
        self.unbind()
        self.work.draws = len(self._programs_in_order)
        self.work.triangles = len(self._programs_in_order) * len(self._corners) // 3
