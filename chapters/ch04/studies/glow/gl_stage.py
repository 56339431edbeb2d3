"""The frame of the studies names and memory on OpenGL; a study adds the order and the images."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping, Sequence

from backends.gl import api as gl
from backends.gl.resources import Image, bind_texture
from backends.gl.targets import begin
from common.view.camera import View

from ...frames.gl import FrameSlot
from ...pipelines.description import PipelineDescription
from ..stage_gl import Stage
from . import EMPTY, TEXELS, Pass, passes, shaders


class GlowStage(Stage):
    """Draws the passes of `passes_in_order()` to `images()`. OpenGL orders draws and what they sample by itself."""

    moves = False
    passes_by_name: Mapping[str, Pass]

    def described(self) -> Mapping[str, Pass]:
        """Return the declared passes by name."""
        return passes()

    @abstractmethod
    def passes_in_order(self) -> Sequence[str]:
        """Return the names of the passes in the order in which the frame runs them."""

    @abstractmethod
    def images(self) -> Mapping[str, Image]:
        """Return a texture for each name that a pass writes."""

    def create(self) -> None:
        """Link a program for each pass."""
        self.passes_by_name = self.described()
        wanted = [
            PipelineDescription(shaders(described), described.defines, depth=None, name=name)
            for name, described in self.passes_by_name.items()
        ]
        self._pipelines = dict(zip(self.passes_by_name, self.pipelines.get(wanted), strict=True))
        self._sampler = self.sampler(TEXELS, "texels")

    def create_sized(self) -> None:
        """Plan the frame, and make what its passes draw to."""
        self._order = self.passes_in_order()
        self._images = self.images()
        written = {
            name: self.passes_by_name[name].writes for name in self._order if self.passes_by_name[name].writes
        }
        self._framebuffers = {
            name: self.framebuffer_of(self._images[target], None, target) for name, target in written.items()
        }

    def draw(self, slot: FrameSlot, view: View, time: float) -> None:
        """Draw the frame; the pass without a target draws to the picture of the stage."""
        self.device.fn.glBindVertexArray(self.no_vertices)
        for name in self._order:
            with self.device.label(name):
                if name in self._framebuffers:
                    begin(self.device, self._framebuffers[name], (EMPTY,))
                else:
                    self.begin()
                self.pipelines.bind(self._pipelines[name], cull=False, front="counter_clockwise")
                for unit, source in enumerate(self.passes_by_name[name].reads):
                    bind_texture(self.device, unit, self._images[source].view, self._sampler)
                self.device.fn.glDrawArrays(gl.GL_TRIANGLES, 0, 3)
            self.work.draws += 1
            self.work.triangles += 1
