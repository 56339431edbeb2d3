"""The study bias-explorer on Vulkan: a kernel records the maps, one counts, and a triangle shows the cells."""

from __future__ import annotations

import numpy as np

from backends.vulkan import api as vk
from backends.vulkan.barriers import barriers
from common.view.camera import View

from ...frames.vulkan import FrameSlot
from ...frames.vulkan_commands import Commands
from ...pipelines.compute_description import ComputeDescription
from ...pipelines.description import PipelineDescription
from ..stage_vulkan import Stage
from . import (
    BIASES,
    COUNTS,
    KERNELS,
    MARGIN,
    SHADERS,
    SIDE,
    STUDY,
    TILTS,
    Settings,
    cells,
    defines,
    planes,
    table,
    told,
    work_of,
)

WRITTEN = (vk.VK_PIPELINE_STAGE_2_COMPUTE_SHADER_BIT, vk.VK_ACCESS_2_SHADER_STORAGE_WRITE_BIT)
READ = (
    vk.VK_PIPELINE_STAGE_2_COMPUTE_SHADER_BIT | vk.VK_PIPELINE_STAGE_2_FRAGMENT_SHADER_BIT,
    vk.VK_ACCESS_2_SHADER_STORAGE_READ_BIT,
)
HOST = (vk.VK_PIPELINE_STAGE_2_HOST_BIT, vk.VK_ACCESS_2_HOST_READ_BIT)


class Renderer(Stage):
    """Tilted planes, each with its map, below five biases."""

    study = STUDY
    settings_class: type = Settings
    moves = False

    def create(self) -> None:
        """Upload the planes; make room for their maps, and for the counts of each frame in flight."""
        macros, many = defines(self.settings), len(TILTS)
        width = SIDE + 2 * MARGIN
        lying = self.filled(planes(self.settings), ["storage"], "planes")
        self.map = self.empty(4 * many * width**2, ["storage"], "maps")
        self._counts = [
            self.shared(COUNTS.itemsize * len(BIASES) * many, f"counts, slot {slot}")
            for slot in range(self.frame_logic.SLOTS)
        ]
        self._record, self._count, self._show = self.pipelines.get(
            [
                *(ComputeDescription(kernel, macros, name=kernel) for kernel in KERNELS),
                PipelineDescription(SHADERS, macros, color="rgba8", depth=None, name="show"),
            ]
        )
        held = {0: lying, 1: self.map}
        self._recording = self.set_of(self._record, held, "record")
        self._drawing = self.set_of(self._show, held, "show")
        self._counting = [self.set_of(self._count, held | {2: counts}, "count") for counts in self._counts]
        self._before = barriers(memory=(*READ, *WRITTEN))  # the maps of the last frame have been read
        self._recorded = barriers(memory=(*WRITTEN, *READ))
        self._counted = barriers(memory=(*WRITTEN, *HOST))
        self._extent = (width, width, many)

    def draw(self, commands: Commands, view: View, time: float) -> None:
        """Record, count and show."""
        self.work = work_of(self.settings)
        commands.barrier(self._before)
        commands.begin_label("record")
        commands.bind_compute(self._record)
        commands.bind_compute_set(self._record, 0, self._recording)
        commands.dispatch_over(self._record, self._extent)
        commands.end_label()
        commands.barrier(self._recorded)
        commands.begin_label("count")
        commands.bind_compute(self._count)
        commands.bind_compute_set(self._count, 0, self._counting[commands.slot.index])
        commands.dispatch(len(BIASES) * len(TILTS))
        commands.end_label()
        commands.barrier(self._counted)
        self.begin(commands)
        commands.bind_pipeline(self._show)
        commands.bind_set(self._show, 0, self._drawing)
        commands.push(self._show, np.array([*self.size, 0, 0], np.float32))
        commands.draw_triangle()
        self.end(commands)

    def read_told(self, slot: FrameSlot) -> dict[str, int]:
        """Return what the slot's frame counted, after a wait for it."""
        self._frames.wait(slot)
        counts = self._counts[slot.index]
        self.device.memory.invalidate(counts.allocation)
        self._last_counts = cells(counts.mapped.copy())
        return told(self._last_counts)

    def failures(self) -> dict[str, np.ndarray]:
        """Return `acne` and `gap`, (B, T) by bias and tilt, of the frame whose counters were read last."""
        return table(self._last_counts)

    def maps(self) -> np.ndarray:
        """Return the maps of the last frame, (T, SIDE + 2 MARGIN, SIDE + 2 MARGIN) float32."""
        width, _, many = self._extent
        return self.download(self.map, WRITTEN).view(np.float32).reshape(many, width, width)
