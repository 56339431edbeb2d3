"""The study render-passes on Vulkan: three passes, begun and ended in either way, with the clock running."""

from __future__ import annotations

from time import perf_counter_ns as now_ns
from typing import Any

from backends.vulkan import api as vk
from common.scene import Sampler
from common.view.camera import View

from ...frames.vulkan_commands import Commands
from ...pipelines.description import Built
from ...pipelines.vulkan_descriptors import Texture
from ..stage_vulkan import Stage
from . import FLAGS, FORMATS, GOES_ON, SCENE, SHOWN, SQUARES, STUDY, PassWork, Settings
from .classic import Classic
from .dynamic import Dynamic
from .pipeline import create_pipeline

SQUARE_SHADERS = ("studies/render_passes/squares.vert", "studies/render_passes/squares.frag")
SHOW_SHADERS = ("post/fullscreen.vert", "studies/render_passes/show.frag")


class Renderer(Stage):
    """Squares in two passes, shown by a third."""

    study = STUDY
    settings_class: type = Settings
    moves = False
    leaves = "copy_source"  # the last pass, or the barrier behind it, has seen to that

    def create(self) -> None:
        """Make passes, where they are objects, and pipelines. The two passes of squares can share one."""
        way = Classic if self.settings.way == "classic" else Dynamic
        started = now_ns()
        self._way: Classic | Dynamic = self.keep(
            way(self.device, FLAGS, FORMATS), lambda passes: passes.close()
        )
        self._made_us = (now_ns() - started) // 1000
        self._squares = self._pipeline(SQUARE_SHADERS, SCENE)
        self._show = self._pipeline(SHOW_SHADERS, SHOWN)
        self._texels = self.sampler(Sampler("nearest", "nearest", None, "clamp", "clamp"), "texels")

    def _pipeline(self, files: tuple[str, str], number: int) -> Built:
        has_depth = FORMATS[number][1] is not None
        pipeline = create_pipeline(
            self.device, self.pipelines.layouts, files, self._way.into(number), depth=has_depth
        )
        self.keep(pipeline.handle, lambda handle: self.device.destroy("VkPipeline", handle))
        return pipeline

    def create_sized(self) -> None:
        """Make the targets, and whatever the way to draw needs anew with them."""
        scene, depth = self.target("scene", "rgba8"), self.target("scene's depth", "d32f")
        layout = self._show.sets[0]
        assert layout is not None  # the shader declares it
        sets = self.descriptors.create([(layout, {0: Texture(scene.view, self._texels)}, "set of the scene")])
        self.keep_sized(sets, self.descriptors.destroy)
        self._set = vk.array("VkDescriptorSet", sets.handles)
        started = now_ns()
        self._way.create_sized(self.size, [(scene, depth), (scene, depth), (self.picture, None)])
        self._sized_us = (now_ns() - started) // 1000
        self.keep_sized(self._way, lambda passes: passes.destroy_sized())

    def draw(self, commands: Commands, view: View, time: float) -> None:
        """Record the three passes."""
        self.work = work = PassWork(objects=self._way.objects, made_us=self._made_us, sized_us=self._sized_us)
        half = SQUARES // 2
        for number in (SCENE, GOES_ON, SHOWN):
            started = now_ns()
            self._way.begin(commands, number)
            work.begin_end_ns += now_ns() - started
            commands.set_area(self.size)
            if number == SHOWN:
                self._bind(commands, self._show)
                commands.bind_set(self._show, 0, self._set)
                commands.draw_triangle()
            else:
                self._bind(commands, self._squares)
                first = 0 if number == SCENE else half
                self.device.fn.vkCmdDraw(commands.handle, 6, half, 0, first)
            started = now_ns()
            self._way.end(commands, number)
            work.begin_end_ns += now_ns() - started
        work.draws, work.triangles = 3, 2 * SQUARES + 1

    def _bind(self, commands: Commands, pipeline: Any) -> None:
        commands.bind_pipeline(pipeline)
