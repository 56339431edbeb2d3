"""The study linear-depth on Vulkan: two depth images of the same lamp, then a triangle that shows both."""

from __future__ import annotations

from typing import Any

from backends.vulkan import api as vk
from backends.vulkan.barriers import barriers, image_barrier
from common.view.camera import View

from ...frames.vulkan_commands import Commands, Rendering
from ...pipelines.description import PipelineDescription
from ...pipelines.vulkan import Pipelines
from ...pipelines.vulkan_descriptors import Texture
from ..stage_vulkan import Stage
from . import RECORD, SHADERS, STUDY, TEXELS, Settings, defines, push, vertices


class BothDirections(Pipelines):
    """The chapter's pipelines, and with the macro STANDARD those for which nearer is less."""

    @staticmethod
    def _depth(described: PipelineDescription) -> Any:
        state = Pipelines._depth(described)
        if ("STANDARD", 1) in described.defines:
            state.depthCompareOp = vk.VK_COMPARE_OP_LESS_OR_EQUAL
        return state


class Renderer(Stage):
    """Records depth in both directions of Z, and shows what is left of the distance."""

    study = STUDY
    settings_class: type = Settings
    moves = False

    def make_pipelines(self) -> Pipelines:
        """Return what builds pipelines of both directions."""
        return BothDirections(self.device)

    def create(self) -> None:
        """Make the pipelines; standard Z needs no fragment shader, since depth is all that it writes."""
        self._reversed, self._standard, self._show = self.pipelines.get(
            [
                PipelineDescription(RECORD, defines(False), color="r32f", name="reversed"),
                PipelineDescription(RECORD[:1], defines(True), color=None, name="standard"),
                PipelineDescription(SHADERS, color="rgba8", depth=None, name="show"),
            ]
        )
        self._nearest = self.sampler(TEXELS, "texels")

    def create_sized(self) -> None:
        """Make both depth images and the image of distances."""
        depth = self.target("reversed", "d32f", "depth", "sampled")
        standard = self.target("standard", "d32f", "standard_depth", "sampled")
        distance = self.target("distance", "r32f", "distance", "sampled")
        held = {
            number: Texture(image.view, self._nearest)
            for number, image in enumerate((depth, standard, distance))
        }
        self._drawing = self.set_of(self._show, held, "images of the lamp", sized=True)
        self._record = (
            (self._reversed, Rendering(self.size, distance, depth, (0.0, 0.0, 0.0, 0.0), 0.0)),
            (self._standard, Rendering(self.size, None, standard, None, 1.0)),
        )
        images = ((depth, "depth"), (standard, "depth"), (distance, "color"))
        self._before = barriers(*(self._start(image, state) for image, state in images))
        self._behind = barriers(
            *(image_barrier(image.handle, image.aspect, state, "sampled") for image, state in images)
        )

    def draw(self, commands: Commands, view: View, time: float) -> None:
        """Record twice, then show."""
        lamp = push(self.settings, self.size)
        commands.barrier(self._before)
        for pipeline, rendering in self._record:
            commands.begin_label(pipeline.described.name)
            commands.begin_rendering(rendering)
            commands.bind_pipeline(pipeline)
            commands.push(pipeline, lamp)
            self.device.fn.vkCmdDraw(commands.handle, vertices(), 1, 0, 0)
            commands.end_rendering()
            commands.end_label()
        commands.barrier(self._behind)
        commands.begin_label("show")
        self.begin(commands)
        commands.bind_pipeline(self._show)
        commands.bind_set(self._show, 0, self._drawing)
        commands.push(self._show, lamp)
        commands.draw_triangle()
        self.end(commands)
        commands.end_label()
        self.work.draws, self.work.triangles = 3, 1 + 2 * vertices() // 3
