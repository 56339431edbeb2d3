"""The study constant-loop on Vulkan: a pipeline for each N, all of one module."""

from __future__ import annotations

import numpy as np

from backends.vulkan import api as vk
from backends.vulkan.barriers import barriers
from common.view.camera import View

from ...frames.vulkan_commands import Commands
from ...pipelines.description import PipelineDescription
from ..stage_vulkan import Stage
from . import SHADERS, STUDY, TAPS, LoopWork, Settings, dispatches, kernel, noise, push

WRITTEN = (vk.VK_PIPELINE_STAGE_2_COMPUTE_SHADER_BIT, vk.VK_ACCESS_2_SHADER_STORAGE_WRITE_BIT)
READ = (vk.VK_PIPELINE_STAGE_2_FRAGMENT_SHADER_BIT, vk.VK_ACCESS_2_SHADER_STORAGE_READ_BIT)


class Renderer(Stage):
    """Means of noise, by a loop of constant length and by one whose length is pushed."""

    study = STUDY
    settings_class: type = Settings
    moves = False

    def create(self) -> None:
        """Upload the noise, make room for all means, and build the pipelines."""
        row = self.filled(noise(self.settings), ["storage"], "noise")
        self.means = self.empty(4 * self.settings.elements * 2 * len(TAPS), ["storage"], "means")
        kernels = [kernel(self.settings, length) for _, _, length in dispatches()]
        shown = PipelineDescription(SHADERS, color="rgba8", depth=None, name="show")
        *self.kernels, self._show = self.pipelines.get([*kernels, shown])
        held = {0: row, 1: self.means}
        self._summing = self.set_of(self.kernels[0], held, "sum")
        self._drawing = self.set_of(self._show, {1: self.means}, "show")
        self._before, self._summed = barriers(memory=(*READ, *WRITTEN)), barriers(memory=(*WRITTEN, *READ))

    def draw(self, commands: Commands, view: View, time: float) -> None:
        """Sum in each way, one dispatch after another with a time for each, and show."""
        slot = commands.slot
        commands.barrier(self._before)
        self._profiler.end(slot)  # each dispatch has a time of its own
        for number, ((name, taps, _), built) in enumerate(zip(dispatches(), self.kernels, strict=True)):
            self._profiler.begin(slot, name)
            commands.bind_compute(built)
            commands.bind_compute_set(built, 0, self._summing)
            commands.push(built, push(self.settings, number, taps))
            commands.dispatch_over(built, (self.settings.elements,))
            self._profiler.end(slot)
        self._profiler.begin(slot, "show")
        commands.barrier(self._summed)
        self.begin(commands)
        commands.bind_pipeline(self._show)
        commands.bind_set(self._show, 0, self._drawing)
        commands.push(self._show, np.array([self.settings.elements, *self.size, len(TAPS)], np.uint32))
        commands.draw_triangle()
        self.end(commands)
        self.work = LoopWork(draws=1, triangles=1, dispatches=len(self.kernels))

    def results(self) -> np.ndarray:
        """Return the means of the last frame, (columns, 2, elements) float32: pushed, then constant."""
        return self.download(self.means, WRITTEN).view(np.float32).reshape(len(TAPS), 2, -1)
