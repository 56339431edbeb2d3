"""The study vertex-pulling on OpenGL: one buffer, read by the GPU as attributes or by the shader as storage."""

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
from . import STUDY, UNIFORM_BYTES, Settings, drawn, uniforms, vertices_of


class Renderer(Drawing):
    """One object of a scene, turning, its vertices fetched in either way."""

    study = STUDY
    settings_class: type = Settings
    folder = Path(__file__).parent
    has_depth = True

    def choose(self, scene: Scene) -> Scene:
        """Return the one object that is drawn."""
        return alone(scene, self.settings.instance)

    def create(self) -> None:
        """Upload vertices and indices, and make the program."""
        primitive, described = primitive_of(self.scene), drawn(self.settings)
        self._vertices = self.filled(vertices_of(primitive), "vertices")
        indices = self.filled(primitive.indices, "indices")
        self._count = len(primitive.indices)
        self._uniforms = self.per_slot(UNIFORM_BYTES, "matrices")
        self._program = self.build(described)
        # Pulled: the vertex array holds the indices alone.
        fetched = self._vertices if self.settings.feed == "attributes" else None
        self._array = self.vertex_array(described, fetched, indices)

    def draw(self, slot: FrameSlot, view: View, time: float) -> None:
        """Draw by index; the calls are the same for both ways, but for the storage that the shader reads."""
        buffer, aspect = self._uniforms[slot.index], self.size[0] / self.size[1]
        buffer.view(np.float32)[:] = uniforms(self.scene, view, time, aspect).ravel()
        self.begin()
        self.bind(self._program)
        bind_buffer(self.device, "uniform", 0, buffer)
        if self.settings.feed == "pulled":
            bind_buffer(self.device, "storage", 1, self._vertices)
        self.device.fn.glBindVertexArray(self._array)
        self.device.fn.glDrawElementsBaseVertex(gl.GL_TRIANGLES, self._count, gl.GL_UNSIGNED_INT, gl.NULL, 0)
        self.unbind()
        self.work.draws, self.work.triangles = 1, self._count // 3
