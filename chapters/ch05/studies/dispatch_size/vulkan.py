"""The study dispatch-size on Vulkan: counters that are cleared, dispatches that add to them, a draw that shows them."""

from __future__ import annotations

import numpy as np

from backends.vulkan import api as vk
from backends.vulkan.barriers import barriers
from common.view.camera import View

from ...frames.vulkan_commands import Commands
from ...pipelines.compute_description import ComputeDescription
from ...pipelines.description import PipelineDescription
from ..stage_vulkan import Stage
from . import KERNEL, SHADERS, STUDY, Settings, check, defines, groups_of, push, room, work_of

CLEARED = (vk.VK_PIPELINE_STAGE_2_ALL_TRANSFER_BIT, vk.VK_ACCESS_2_TRANSFER_WRITE_BIT)
READ, WRITE = vk.VK_ACCESS_2_SHADER_STORAGE_READ_BIT, vk.VK_ACCESS_2_SHADER_STORAGE_WRITE_BIT
COUNTED = (vk.VK_PIPELINE_STAGE_2_COMPUTE_SHADER_BIT, READ | WRITE)
DRAWN = (vk.VK_PIPELINE_STAGE_2_FRAGMENT_SHADER_BIT, READ)


class Renderer(Stage):
    """A picture of how often each of its places was reached."""

    study = STUDY
    settings_class: type = Settings
    moves = False

    def create(self) -> None:
        """Make the counters, both pipelines, and the barriers between clearing, counting and drawing."""
        settings = self.settings
        check(settings)
        self._groups, self._work = groups_of(settings), work_of(settings)
        self._counters = self.empty(4 * room(settings), ["storage"], "counters")
        self._kernel, self._show = self.pipelines.get(
            [
                ComputeDescription(KERNEL, defines(settings), name=settings.local),
                PipelineDescription(
                    SHADERS, (("REPEAT", settings.repeat),), color="rgba8", depth=None, name="show"
                ),
            ]
        )
        self._counting = self.set_of(self._kernel, {0: self._counters}, "counters of the kernel")
        self._showing = self.set_of(self._show, {0: self._counters}, "counters to show")
        self._before_clear = barriers(memory=(*DRAWN, *CLEARED))
        self._before_kernel = barriers(memory=(*CLEARED, *COUNTED))
        # Atomics have no order, but lose nothing: dispatches that only add need no barrier between them.
        self._before_show = barriers(memory=(COUNTED[0], WRITE, *DRAWN))

    def draw(self, commands: Commands, view: View, time: float) -> None:
        """Clear, count and show."""
        fn, numbers = self.device.fn, push(self.settings, self.size)
        self.work = self._work
        commands.barrier(self._before_clear)
        commands.begin_label("clear")
        fn.vkCmdFillBuffer(commands.handle, self._counters.handle, 0, vk.VK_WHOLE_SIZE, 0)
        commands.end_label()
        commands.barrier(self._before_kernel)
        commands.begin_label("kernel")
        commands.bind_compute(self._kernel)
        commands.bind_compute_set(self._kernel, 0, self._counting)
        commands.push(self._kernel, numbers)
        for _ in range(self.settings.repeat):
            commands.dispatch(*self._groups)
        commands.end_label()
        commands.barrier(self._before_show)
        commands.begin_label("show")
        self.begin(commands)
        commands.bind_pipeline(self._show)
        commands.bind_set(self._show, 0, self._showing)
        commands.push(self._show, numbers)
        commands.draw_triangle()
        self.end(commands)
        commands.end_label()

    def counters(self) -> np.ndarray:
        """Return how often each place was reached in the last frame, (room,) uint32, row after row."""
        return self.download(self._counters, (COUNTED[0], WRITE)).view(np.uint32)
