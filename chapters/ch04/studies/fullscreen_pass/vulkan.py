"""The study fullscreen-pass on Vulkan: one vertex shader, no vertex buffer, a draw of three or six for each output."""

from __future__ import annotations

from typing import Any

from backends.vulkan.barriers import barriers, image_barrier
from common.view.camera import View

from ...frames.vulkan_commands import Commands, Rendering
from ...pipelines.description import PipelineDescription
from ..stage_vulkan import Stage
from . import EMPTY, SHADERS, STUDY, VERTICES, WRITTEN, Settings, defines


class Renderer(Stage):
    """Fills a picture, and with it the targets that tell how well it was filled."""

    study = STUDY
    settings_class: type = Settings
    moves = False

    def create(self) -> None:
        """Make a pipeline for each output; that one is filled by three vertices and another by six, none can see."""
        self._drawn = dict.fromkeys(("color", *self.outputs))
        wanted = [
            PipelineDescription(
                SHADERS,
                defines(self.settings, output),
                color=WRITTEN[output].format,
                depth=None,
                blend=WRITTEN[output].blend,
                name=f"{self.settings.shape}, {output}",
            )
            for output in self._drawn
        ]
        self._pipelines = dict(zip(self._drawn, self.pipelines.get(wanted), strict=True))

    def create_sized(self) -> None:
        """Make the targets of outputs that were asked for, and what begins drawing to each."""
        images = {"color": self.picture}
        for output in self._drawn:
            if output != "color":
                images[output] = self.target(output, WRITTEN[output].format, output)
        self._renderings = {name: Rendering(self.size, image, None, EMPTY) for name, image in images.items()}
        starts: list[Any] = [
            image_barrier(target.handle, target.aspect, "copy_source", "color", discard=True)
            for target in images.values()
        ]
        self._ready = barriers(*starts)

    def draw(self, commands: Commands, view: View, time: float) -> None:
        """Fill each target. They have nothing to do with one another: one barrier readies them all."""
        vertices = VERTICES[self.settings.shape]
        commands.barrier(self._ready)
        for output, rendering in self._renderings.items():
            commands.begin_rendering(rendering)
            pipeline = self._pipelines[output]
            commands.bind_pipeline(pipeline)
            self.device.fn.vkCmdDraw(commands.handle, vertices, 1, 0, 0)
            commands.end_rendering()
            self.work.draws += 1
            self.work.triangles += vertices // 3
