"""The study first-triangle on OpenGL: a program, and one by one the state that a Vulkan pipeline holds as a whole."""

from __future__ import annotations

from pathlib import Path

from backends import shader_text
from backends.gl import api as gl
from backends.gl.programs import Programs
from common.view.camera import View

from ...frames.gl import FrameSlot
from ..stage_gl import Stage
from . import STUDY

FOLDER = Path(__file__).parent


class Renderer(Stage):
    """A triangle without a vertex buffer."""

    study = STUDY
    moves = False

    def create(self) -> None:
        """Link both shaders to one program. OpenGL takes the text itself; the driver brings a compiler."""
        self._programs = Programs(self.device)
        files = ("triangle.vert", "triangle.frag")
        self._program = self._programs.get([shader_text.build(FOLDER / file, "gl") for file in files])

    def draw(self, slot: FrameSlot, view: View, time: float) -> None:
        """Set the state, one call for each part of it, and draw. Whatever is not set is what the last user left."""
        fn = self.device.fn
        self.begin()  # the framebuffer, cleared, and the viewport over all of it
        fn.glUseProgram(self._program.handle)
        fn.glDisable(gl.GL_CULL_FACE)
        fn.glDisable(gl.GL_DEPTH_TEST)
        fn.glDisable(gl.GL_BLEND)
        # A vertex array says where vertices come from. Here from nowhere, and still one must be bound.
        fn.glBindVertexArray(self.no_vertices)
        fn.glDrawArrays(gl.GL_TRIANGLES, 0, 3)
        self.work.draws, self.work.triangles = 1, 1

    def destroy(self) -> None:
        """Free the program."""
        if hasattr(self, "_programs"):
            self._programs.close()
