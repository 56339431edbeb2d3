"""The study compute-buffers on Vulkan: mapped buffers, a dispatch, and the barriers behind it."""

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
"""By whom, and how, the numbers that come out are written: the first half of every barrier behind the kernel."""

DRAWN = (vk.VK_PIPELINE_STAGE_2_FRAGMENT_SHADER_BIT, vk.VK_ACCESS_2_SHADER_STORAGE_READ_BIT)
TO_CPU = (vk.VK_PIPELINE_STAGE_2_HOST_BIT, vk.VK_ACCESS_2_HOST_READ_BIT)


class Renderer(Stage):
    """A kernel whose numbers are drawn, and compared on the CPU two frames later."""

    study = STUDY
    settings_class: type = Settings
    numbers = staticmethod(numbers)  # yours may stand here

    def create(self) -> None:
        """Make two buffers for each frame in flight, and the sets that show them to the kernel and to the draw."""
        count = self.settings.count
        # What the CPU writes, and the GPU reads once, lies in the CPU's memory; so does what goes the other way.
        self._x = self.per_slot(4 * count, "storage", "x")
        self._y = [self.shared(4 * count, f"y, slot {slot}") for slot in range(SLOTS)]
        self._kernel, self._bars = self.pipelines.get(
            [
                ComputeDescription(KERNEL, name="kernel"),
                PipelineDescription(SHADERS, defines(self.settings), color="rgba8", depth=None, name="bars"),
            ]
        )
        held = [{0: self._x[slot], 1: self._y[slot]} for slot in range(SLOTS)]
        self._computing = [self.set_of(self._kernel, one, "numbers of the kernel") for one in held]
        self._drawing = [self.set_of(self._bars, one, "numbers of the bars") for one in held]
        self._push = push(self.settings)
        self._for_bars = barriers(memory=(*WRITTEN, *DRAWN))
        self._for_cpu = barriers(memory=(*WRITTEN, *TO_CPU))
        self._expected: list[np.ndarray | None] = [None] * SLOTS

    def draw(self, commands: Commands, view: View, time: float) -> None:
        """Check what the slot's last frame computed, upload, compute, draw."""
        slot = commands.slot.index
        self.work = KernelWork(draws=1, triangles=1, dispatches=1)
        self._check(slot)
        x = self._x[slot].view(np.uint32)
        x[:] = self.numbers(self.settings, time)  # memory that is mapped: this is the upload
        self._expected[slot] = expected(x, self.settings)
        commands.begin_label("kernel")
        commands.bind_compute(self._kernel)
        commands.bind_compute_set(self._kernel, 0, self._computing[slot])
        commands.push(self._kernel, self._push)
        commands.dispatch_over(self._kernel, (self.settings.count,))  # as many groups as it takes
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
        """Compare what came back; the slot's last frame is over, or it would not have been given to this one."""
        wanted, work = self._expected[slot], self.work
        if wanted is not None and isinstance(work, KernelWork):
            work.checked, work.wrong = wanted.size, int((self.downloaded(slot) != wanted).sum())

    def downloaded(self, slot: int) -> np.ndarray:
        """Return what the kernel wrote in the slot's last frame, (count,) uint32. That frame must be over."""
        self.device.memory.invalidate(self._y[slot].allocation)  # where memory is cached, but not coherent
        return self._y[slot].view(np.uint32)
