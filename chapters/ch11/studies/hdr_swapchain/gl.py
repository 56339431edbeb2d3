"""The study hdr-swapchain on OpenGL: the same passes. Windows have 8 bits and sRGB here."""

from __future__ import annotations

from backends.gl import api as gl
from backends.gl.resources import bind_texture
from backends.gl.targets import Framebuffer, begin
from common.view.camera import View

from ...frames.gl import FrameSlot
from ...pipelines.description import PipelineDescription
from ..stage_gl import Stage
from . import FORMATS, PASSES, STUDY, TEXELS, TRIANGLE, WRITES, Settings, check, decide, defines

WINDOW = (
    "an OpenGL window has no surface of high dynamic range, since GLFW asks for neither a colour space nor half "
    f"floats: {WRITES['srgb']}."
)


class Renderer(Stage):
    """Three triangles: the scene, its signal, and the picture. `encoding` is what the last pass writes."""

    study = STUDY
    settings_class: type = Settings
    moves = False

    def create(self) -> None:
        """Choose the encoding, and make the programs."""
        check(self.settings)
        offered = "srgb" if self.presents else None
        self.encoding = decide(self.settings.encoding, offered)
        self.matches = offered == self.encoding
        if self.presents and WINDOW not in self.scene.warnings:
            self.scene.warnings.append(WINDOW)
        macros = defines(self.settings, self.encoding)
        self._pipelines = self.pipelines.get(
            [
                PipelineDescription((TRIANGLE, file), macros, depth=None, name=name)
                for name, file in PASSES.items()
            ]
        )
        self._nearest = self.sampler(TEXELS, "texels")

    def create_sized(self) -> None:
        """Make the image of light and the encoded one, and what draws to them."""
        light = self.target("light", "rgba16f")
        encoded = self.target("encoded", FORMATS[self.encoding], "encoded")
        self._encoded = self.framebuffer_of(encoded, None, "encoded")
        self._targets_of = (self.framebuffer_of(light, None, "light"), self._encoded, self.framebuffer)
        self._read_by = (None, light, encoded)

    def draw(self, slot: FrameSlot, view: View, time: float) -> None:
        """Draw the scene, encode it, and show what was written. The driver orders a texture's writes and reads."""
        fn = self.device.fn
        fn.glBindVertexArray(self.no_vertices)
        for pipeline, target, image in zip(self._pipelines, self._targets_of, self._read_by, strict=True):
            begin(self.device, target, ((0.0, 0.0, 0.0, 0.0),))
            self.pipelines.bind(pipeline, cull=False, front="counter_clockwise")
            if image is not None:
                bind_texture(self.device, 0, image.view, self._nearest)
            fn.glDrawArrays(gl.GL_TRIANGLES, 0, 3)
        self.work.draws = self.work.triangles = 3

    @property
    def present_source(self) -> Framebuffer:
        """The picture for a window: the encoded one if a window takes it as it is, else the one that explains it."""
        return self._encoded if self.matches else super().present_source
