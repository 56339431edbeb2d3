"""The study compute-buffers on Vulkan: mapped buffers, a dispatch, and the barriers after it."""

from __future__ import annotations

import numpy as np

from backends.vulkan import api as vk
from backends.vulkan.barriers import barriers
from common.view.camera import View

from ...frames.frame import SLOTS
from ...frames.vulkan_commands import Commands
from ...pipelines.compute_description import ComputeDescription
from ...pipelines.description import PipelineDescription
from ..stage_vulkan import Stage
from . import KERNEL, SHADERS, STUDY, KernelWork, Settings, defines, expected, numbers, push

WRITTEN = (vk.VK_PIPELINE_STAGE_2_COMPUTE_SHADER_BIT, vk.VK_ACCESS_2_SHADER_STORAGE_WRITE_BIT)
"""Stage and access of the kernel's writes: the first half of every barrier after the kernel."""

DRAWN = (vk.VK_PIPELINE_STAGE_2_FRAGMENT_SHADER_BIT, vk.VK_ACCESS_2_SHADER_STORAGE_READ_BIT)
TO_CPU = (vk.VK_PIPELINE_STAGE_2_HOST_BIT, vk.VK_ACCESS_2_HOST_READ_BIT)


class Renderer(Stage):
    """A kernel whose numbers are drawn, and compared on the CPU two frames later."""

    study = STUDY
    settings_class: type = Settings
    numbers = staticmethod(numbers)  # a fork may replace it

    def create(self) -> None:
        """Make two buffers for each frame in flight, and the descriptor sets of the kernel and the draw."""
        count = self.settings.count
        # Buffers that the CPU writes and the GPU reads once are in the CPU's memory; so are those for the other way.
        self._x = self.per_slot(4 * count, "storage", "x")
        self._y = [self.shared(4 * count, f"y, slot {slot}") for slot in range(SLOTS)]
        self._kernel, self._bars = self.pipelines.get(
            [
                ComputeDescription(KERNEL, name="kernel"),
                PipelineDescription(SHADERS, defines(self.settings), color="rgba8", depth=None, name="bars"),
            ]
        )
        buffers = [{0: self._x[slot], 1: self._y[slot]} for slot in range(SLOTS)]
        self._computing = [
            self.set_of(self._kernel, bindings, "numbers of the kernel") for bindings in buffers
        ]
        self._drawing = [self.set_of(self._bars, bindings, "numbers of the bars") for bindings in buffers]
        self._push = push(self.settings)
        self._for_bars = barriers(memory=(*WRITTEN, *DRAWN))
        self._for_cpu = barriers(memory=(*WRITTEN, *TO_CPU))
        self._expected: list[np.ndarray | None] = [None] * SLOTS

    def draw(self, commands: Commands, view: View, time: float) -> None:
        """Check the results of the slot's last frame, upload, compute, draw."""
        slot = commands.slot.index
        self.work = KernelWork(draws=1, triangles=1, dispatches=1)
        self._check(slot)
        x = self._x[slot].view(np.uint32)
        x[:] = self.numbers(self.settings, time)  # mapped memory: this is the upload
        self._expected[slot] = expected(x, self.settings)
        commands.begin_label("kernel")
        commands.bind_compute(self._kernel)
        commands.bind_compute_set(self._kernel, 0, self._computing[slot])
        commands.push(self._kernel, self._push)
        commands.dispatch_over(self._kernel, (self.settings.count,))  # enough groups for all numbers
        commands.end_label()
        commands.barrier(self._for_bars)
        commands.begin_label("bars")
        self.begin(commands)
        commands.bind_pipeline(self._bars)
        commands.bind_set(self._bars, 0, self._drawing[slot])
        commands.draw_triangle()
        self.end(commands)
        commands.end_label()
        commands.barrier(self._for_cpu)

    def _check(self, slot: int) -> None:
        """Compare the results of the slot's last frame, which is over: otherwise this frame would not have the slot."""
        true_y, work = self._expected[slot], self.work
        if true_y is not None and isinstance(work, KernelWork):
            work.checked, work.wrong = true_y.size, int((self.downloaded(slot) != true_y).sum())

    def downloaded(self, slot: int) -> np.ndarray:
        """Return the kernel's results of the slot's last frame, (count,) uint32. That frame must be over."""
        self.device.memory.invalidate(self._y[slot].allocation)  # where memory is cached, but not coherent
        return self._y[slot].view(np.uint32)
