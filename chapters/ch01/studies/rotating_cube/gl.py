"""The study rotating-cube on OpenGL: a uniform buffer per frame in flight, bound to a number, and depth."""

from __future__ import annotations

import numpy as np

from backends.gl import api as gl
from backends.gl.resources import Buffer, bind_buffer, create_buffer, destroy_buffer
from common.view.camera import View

from ...frames.frame import SLOTS
from ...frames.gl import FrameSlot
from ...pipelines.description import PipelineDescription
from ..stage_gl import Stage
from . import STUDY, matrices

UNIFORM_BYTES = 2 * 64


class Renderer(Stage):
    """A cube whose corners are in the shader; only its place comes from here."""

    study = STUDY
    has_depth = True

    def create(self) -> None:
        """Make the buffers and the program."""
        # OpenGL would copy what `glBufferSubData` gets, and keep order by itself. Mapped memory it does not protect:
        # there are as many buffers as frames in flight, as on Vulkan, and a frame's fence says when to write again.
        self._uniforms: list[Buffer] = []
        for slot in range(SLOTS):
            name = f"matrices, slot {slot}"
            self._uniforms.append(create_buffer(self.device, UNIFORM_BYTES, "upload", name))
        # A program, and the state that `bind` sets with it. `depth="write"` draws a pixel only where it is not behind
        # what was drawn there before, and notes how near it is.
        described = PipelineDescription(
            shaders=("studies/rotating_cube/cube.vert", "studies/rotating_cube/cube.frag"),
            depth="write",
            name="cube",
        )
        self._pipeline = self.pipelines.get([described])[0]

    def draw(self, slot: FrameSlot, view: View, time: float) -> None:
        """Write this frame's matrices and draw."""
        uniforms = self._uniforms[slot.index]
        uniforms.view(np.float32)[:] = matrices(view, time, self.size[0] / self.size[1]).ravel()
        self.begin()
        self.pipelines.bind(self._pipeline, cull=False, front="counter_clockwise")
        # No descriptor sets: each buffer is bound to its number, one call for each.
        bind_buffer(self.device, "uniform", 0, uniforms)
        self.device.fn.glBindVertexArray(self.no_vertices)
        self.device.fn.glDrawArrays(gl.GL_TRIANGLES, 0, 36)
        self.work.draws, self.work.triangles = 1, 12

    def destroy(self) -> None:
        """Free the buffers; the program belongs to the stage."""
        for buffer in getattr(self, "_uniforms", ()):
            destroy_buffer(self.device, buffer)
