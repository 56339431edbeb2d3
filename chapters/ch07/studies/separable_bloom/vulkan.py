"""The study separable-bloom on Vulkan: a barrier between kernels, since each reads what the one before wrote."""

from __future__ import annotations

import numpy as np

from backends.vulkan import api as vk
from backends.vulkan.barriers import barriers
from common.view.camera import View

from ...frames.vulkan_commands import Commands
from ...pipelines.compute_description import ComputeDescription
from ...pipelines.description import PipelineDescription
from ..stage_vulkan import Stage
from . import FOLDER, KERNELS, SHADERS, SIDE, STUDY, Settings, defines, order, picture, work_of

WRITTEN = (vk.VK_PIPELINE_STAGE_2_COMPUTE_SHADER_BIT, vk.VK_ACCESS_2_SHADER_STORAGE_WRITE_BIT)
DRAWN = (vk.VK_PIPELINE_STAGE_2_FRAGMENT_SHADER_BIT, vk.VK_ACCESS_2_SHADER_STORAGE_READ_BIT)


class Renderer(Stage):
    """A bright pass, blurs, and a triangle that shows them."""

    study = STUDY
    settings_class: type = Settings
    moves = False
    light = staticmethod(picture)  # a fork may replace it

    def create(self) -> None:
        """Upload the picture, and make the kernels."""
        self.source = self.filled(self.light().reshape(-1), ["storage"], "picture")
        self.bloom, self.across = (
            self.empty(16 * SIDE * SIDE, ["storage"], name) for name in ("bloom", "across")
        )
        self._kernels = dict(
            zip(
                KERNELS,
                self.pipelines.get(
                    [
                        ComputeDescription(f"{FOLDER}/{file}", defines(self.settings, axis), name=name)
                        for name, (file, axis) in KERNELS.items()
                    ]
                ),
                strict=True,
            )
        )
        described = PipelineDescription(
            SHADERS, defines(self.settings), color="rgba8", depth=None, name="show"
        )
        self._show = self.pipelines.get([described])[0]
        used = {
            "bright": (self.source, self.bloom),
            "across": (self.bloom, self.across),
            "down": (self.across, self.bloom),
        }
        self._sets = {
            name: self.set_of(self._kernels[name], dict(enumerate(buffers)), name)
            for name, buffers in used.items()
        }
        self._drawing = self.set_of(self._show, {0: self.source, 1: self.bloom}, "show")
        self._before = barriers(memory=(*DRAWN, *WRITTEN))  # the kernels wait for the draw of the last frame
        self._behind = barriers(memory=(*WRITTEN, *DRAWN))  # the draw sees the writes

    def draw(self, commands: Commands, view: View, time: float) -> None:
        """Blur and show."""
        self.work = work_of(self.settings)
        commands.barrier(self._before)
        commands.begin_label("kernels")
        for number, name in enumerate(order(self.settings)):
            if number:
                commands.compute_barrier()
            commands.bind_compute(self._kernels[name])
            commands.bind_compute_set(self._kernels[name], 0, self._sets[name])
            commands.dispatch_over(self._kernels[name], (SIDE, SIDE))
        commands.end_label()
        commands.barrier(self._behind)
        commands.begin_label("show")
        self.begin(commands)
        commands.bind_pipeline(self._show)
        commands.bind_set(self._show, 0, self._drawing)
        commands.draw_triangle()
        self.end(commands)
        commands.end_label()

    def blurred(self) -> np.ndarray:
        """Return the bloom of the last frame, (SIDE, SIDE, 3) float32."""
        return self.download(self.bloom, WRITTEN).view(np.float32).reshape(SIDE, SIDE, 4)[..., :3]
