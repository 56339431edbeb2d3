"""What draws of a study are made of on OpenGL, each by one call: vertex arrays and programs."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from backends import shader_text
from backends.gl import api as gl
from backends.gl.programs import Program, Programs
from backends.gl.resources import Buffer

from .drawing import Drawn
from .stage_gl import Stage


@dataclass(frozen=True)
class Built:
    """A program, and the description whose state is set with it."""

    program: Program
    described: Drawn


class Drawing(Stage):
    """A stage for studies that draw with more than the chapter's own pipelines can."""

    folder: Path

    def build(self, described: Drawn) -> Built:
        """Return a program, with the state that `bind` sets."""
        if not hasattr(self, "_programs"):
            self._programs = Programs(self.device)
        sources = [
            shader_text.build(self.folder / file, "gl", defines=dict(described.defines))
            for file in described.shaders
        ]
        return Built(self._programs.get(sources, self.study.title), described)

    def vertex_array(self, described: Drawn, vertices: Buffer | None, indices: Buffer | None) -> int:
        """Return a vertex array: where the attributes of a description lie in a buffer, and the indices."""
        fn, handle = self.device.fn, self.device.create("vertex array", self.study.title)
        self._arrays = [*getattr(self, "_arrays", ()), handle]
        for attribute in described.attributes if vertices is not None else ():
            fn.glEnableVertexArrayAttrib(handle, attribute.location)
            fn.glVertexArrayAttribFormat(
                handle, attribute.location, attribute.floats, gl.GL_FLOAT, 0, attribute.offset
            )
            fn.glVertexArrayAttribBinding(handle, attribute.location, 0)
        if described.attributes and vertices is not None:
            fn.glVertexArrayVertexBuffer(handle, 0, vertices.handle, 0, described.stride)
        if indices is not None:
            fn.glVertexArrayElementBuffer(handle, indices.handle)
        return handle

    def bind(self, built: Built) -> None:
        """Draw with a program from here on, both sides of each triangle."""
        fn, described = self.device.fn, built.described
        fn.glUseProgram(built.program.handle)
        fn.glDisable(gl.GL_CULL_FACE)
        fn.glDisable(gl.GL_BLEND)
        (fn.glEnable if described.depth else fn.glDisable)(gl.GL_DEPTH_TEST)
        fn.glDepthFunc(gl.GL_GEQUAL)
        fn.glDepthMask(1)
        fn.glPolygonMode(gl.GL_FRONT_AND_BACK, gl.GL_FILL if described.filled else gl.GL_LINE)
        # Reversed z: what is farther away has the smaller depth, and so back is negative.
        (fn.glEnable if described.push_back else fn.glDisable)(gl.GL_POLYGON_OFFSET_FILL)
        fn.glPolygonOffset(-described.push_back, -described.push_back)

    def unbind(self) -> None:
        """Put back what others never set: the context is theirs too."""
        self.device.fn.glPolygonMode(gl.GL_FRONT_AND_BACK, gl.GL_FILL)
        self.device.fn.glDisable(gl.GL_POLYGON_OFFSET_FILL)

    def destroy(self) -> None:
        """Free vertex arrays and programs; buffers belong to the stage."""
        for handle in getattr(self, "_arrays", ()):
            self.device.destroy("vertex array", handle)
        if hasattr(self, "_programs"):
            self._programs.close()
