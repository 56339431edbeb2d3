"""The study linear-depth on OpenGL; compare vulkan.py."""

from __future__ import annotations

from backends.gl import api as gl
from backends.gl.resources import bind_texture
from backends.gl.targets import begin, create_framebuffer, destroy_framebuffer
from common.view.camera import View

from ...frames.gl import FrameSlot
from ...pipelines.description import PipelineDescription
from ..stage_gl import Stage
from . import RECORD, SHADERS, STUDY, TEXELS, Settings, defines, push, vertices


class Renderer(Stage):
    """Records depth in both directions of Z, and shows what is left of the distance."""

    study = STUDY
    settings_class: type = Settings
    moves = False

    def create(self) -> None:
        """Make the programs."""
        self._pipelines = self.pipelines.get(
            [
                PipelineDescription(RECORD, defines(False), name="reversed"),
                PipelineDescription(RECORD[:1], defines(True), name="standard"),
                PipelineDescription(SHADERS, depth=None, name="show"),
            ]
        )
        self._nearest = self.sampler(TEXELS, "texels")

    def create_sized(self) -> None:
        """Make both depth images and the image of distances, and what draws to them."""
        names = {"reversed": "depth", "standard": "standard_depth"}
        self._depths = [self.target(name, "d32f", output) for name, output in names.items()]
        self._distance = self.target("distance", "r32f", "distance")
        self._recorded = self.framebuffer_of(self._distance, self._depths[0], "reversed")
        alone = create_framebuffer(self.device, [], self._depths[1], "standard")
        self._alone = self.keep_sized(
            alone, lambda framebuffer: destroy_framebuffer(self.device, framebuffer)
        )

    def draw(self, slot: FrameSlot, view: View, time: float) -> None:
        """Record twice, then show. The depth test of standard Z is set behind that of the pipeline."""
        fn, lamp = self.device.fn, push(self.settings, self.size)
        fn.glBindVertexArray(self.no_vertices)
        targets = ((self._recorded, (0.0, 0.0, 0.0, 0.0), 0.0), (self._alone, None, 1.0))
        for pipeline, (target, nothing, farthest) in zip(self._pipelines, targets, strict=False):
            begin(self.device, target, () if nothing is None else (nothing,), farthest)
            self.pipelines.bind(pipeline, cull=False, front="counter_clockwise")
            if target is self._alone:
                fn.glDepthFunc(gl.GL_LEQUAL)
            self.device.push(lamp)
            fn.glDrawArrays(gl.GL_TRIANGLES, 0, vertices())
        self.begin()
        self.pipelines.bind(self._pipelines[2], cull=False, front="counter_clockwise")
        for unit, image in enumerate((*self._depths, self._distance)):
            bind_texture(self.device, unit, image.view, self._nearest)
        self.device.push(lamp)
        fn.glDrawArrays(gl.GL_TRIANGLES, 0, 3)
        self.work.draws, self.work.triangles = 3, 1 + 2 * vertices() // 3
