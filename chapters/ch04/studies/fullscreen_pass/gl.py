"""The study fullscreen-pass on OpenGL: an empty vertex array, and a draw of three or six vertices for each output."""

from __future__ import annotations

from backends.gl import api as gl
from backends.gl.targets import begin
from common.view.camera import View

from ...frames.gl import FrameSlot
from ...pipelines.description import PipelineDescription
from ..stage_gl import Stage
from . import EMPTY, SHADERS, STUDY, VERTICES, WRITTEN, Settings, defines


class Renderer(Stage):
    """Fills a picture, and with it the targets that tell how well it was filled."""

    study = STUDY
    settings_class: type = Settings
    moves = False

    def create(self) -> None:
        """Make a program for each output."""
        self._drawn = dict.fromkeys(("color", *self.outputs))
        wanted = [
            PipelineDescription(
                SHADERS,
                defines(self.settings, output),
                depth=None,
                blend=WRITTEN[output].blend,
                name=f"{self.settings.shape}, {output}",
            )
            for output in self._drawn
        ]
        self._pipelines = dict(zip(self._drawn, self.pipelines.get(wanted), strict=True))

    def create_sized(self) -> None:
        """Make the targets of outputs that were asked for, and what draws to each."""
        self._framebuffers = {"color": self.framebuffer}
        for output in self._drawn:
            if output != "color":
                image = self.target(output, WRITTEN[output].format, output)
                self._framebuffers[output] = self.framebuffer_of(image, None, output)

    def draw(self, slot: FrameSlot, view: View, time: float) -> None:
        """Fill each target."""
        vertices = VERTICES[self.settings.shape]
        # Some vertex array must be bound, even if no shader reads from it.
        self.device.fn.glBindVertexArray(self.no_vertices)
        for output, framebuffer in self._framebuffers.items():
            begin(self.device, framebuffer, (EMPTY,))
            self.pipelines.bind(self._pipelines[output], cull=False, front="counter_clockwise")
            self.device.fn.glDrawArrays(gl.GL_TRIANGLES, 0, vertices)
            self.work.draws += 1
            self.work.triangles += vertices // 3
