"""The study ordered-layers on OpenGL: a framebuffer to bind for each item, and no barrier to forget."""

from __future__ import annotations

from backends.gl import api as gl
from backends.gl.resources import Image, bind_texture
from backends.gl.targets import begin
from common.scene import Sampler
from common.view.camera import View

from ...frames.gl import FrameSlot
from ...pipelines.description import PipelineDescription
from ..stage_gl import Stage
from . import CLEAR, SCREEN, SHADERS, STUDY, Item, LayerWork, Settings, defines, items, passes_of


class Renderer(Stage):
    """Items in a list, from back to front."""

    study = STUDY
    settings_class: type = Settings
    moves = False
    items = staticmethod(items)  # yours may stand here

    def create(self) -> None:
        """Make a program for each item that is enabled; for others nothing is made."""
        listed = self.items(self.settings)
        self._passes = passes_of(listed, self.settings.merge)
        self._enabled = [item for item in listed if item.enabled]
        wanted = [
            PipelineDescription(SHADERS, defines(item), depth=None, blend="over", name=item.name)
            for item in self._enabled
        ]
        self._pipelines = dict(zip(self._enabled, self.pipelines.get(wanted), strict=True))
        self._texels = self.sampler(Sampler("nearest", "nearest", None, "clamp", "clamp"), "texels")

    def create_sized(self) -> None:
        """Make the targets of items that have one."""
        own = dict.fromkeys(item.output for item in self._enabled if item.output != SCREEN)
        self._images: dict[str, Image] = {name: self.target(name, "rgba8") for name in own}
        self._framebuffers = {SCREEN: self.framebuffer}
        for name, image in self._images.items():
            self._framebuffers[name] = self.framebuffer_of(image, None, name)

    def draw(self, slot: FrameSlot, view: View, time: float) -> None:
        """Do each pass with its items; the first to a target clears it, later ones draw on what is there."""
        self.work = work = LayerWork()
        self.device.fn.glBindVertexArray(self.no_vertices)
        begun = set()
        for output, drawn in self._passes:
            begin(self.device, self._framebuffers[output], () if output in begun else (CLEAR,))
            begun.add(output)
            for item in drawn:
                with self.device.label(item.name):
                    self._draw_item(item)
            work.passes += 1
        work.draws = work.triangles = len(self._enabled)

    def _draw_item(self, item: Item) -> None:
        self.pipelines.bind(self._pipelines[item], cull=False, front="counter_clockwise")
        if item.reads:
            bind_texture(self.device, 0, self._images[item.reads].view, self._texels)
        self.device.fn.glDrawArrays(gl.GL_TRIANGLES, 0, 3)
