"""The study shading-rates on Vulkan: two draws, with a query around each, and rates from one of four sources."""

from __future__ import annotations

import numpy as np

from backends.vulkan import api as vk
from backends.vulkan.barriers import barriers
from common.view.camera import View

from ...frames.vulkan import FrameSlot
from ...frames.vulkan_commands import Commands
from ...pipelines.vulkan import Pipelines
from ...rates.model import decode
from ..stage_vulkan import Stage
from . import (
    BY_PRIMITIVE,
    COLUMNS,
    ROWS,
    STUDY,
    RateWork,
    Settings,
    code_of,
    defines,
    push,
    shaders,
    side_of,
    told,
)
from .rated import Rated, RatedPipelines, check_device, command_of

CELLS = COLUMNS * ROWS // 2  # of a draw
COUNTED = (
    vk.VK_PIPELINE_STAGE_2_FRAGMENT_SHADER_BIT,
    vk.VK_ACCESS_2_SHADER_STORAGE_READ_BIT | vk.VK_ACCESS_2_SHADER_STORAGE_WRITE_BIT,
)
CLEARED = (vk.VK_PIPELINE_STAGE_2_ALL_TRANSFER_BIT, vk.VK_ACCESS_2_TRANSFER_WRITE_BIT)
HOST = (vk.VK_PIPELINE_STAGE_2_HOST_BIT, vk.VK_ACCESS_2_HOST_READ_BIT)


class Renderer(Stage):
    """Two draws of cells, whose fragments are counted."""

    study = STUDY
    settings_class: type = Settings
    moves = False
    background = (0.02, 0.02, 0.02, 1.0)

    def make_pipelines(self) -> Pipelines:
        """Return what builds pipelines with rates."""
        return RatedPipelines(self.device)

    def create(self) -> None:
        """Make the pipelines of both draws, the queries, and the counts."""
        settings, device = self.settings, self.device
        check_device(device, self.without, settings)
        side_of(self.size)
        by_primitive, by_command = settings.source in BY_PRIMITIVE, settings.source == "dynamic"
        rate = decode(code_of(settings))
        each = {
            "shaders": shaders(settings),
            "defines": defines(settings),
            "color": "rgba8",
            "depth": None,
            "set_by_command": by_command,
            "replaced": by_primitive and settings.combiner == "replace",
        }
        lower = rate if settings.source == "pipeline" else (1, 1)
        self._draws = self.pipelines.get(
            [Rated(**each, name="upper"), Rated(**each, name="lower", rate=lower)]
        )
        self._commands = [command_of(size) for size in ((1, 1), rate)] if by_command else []
        slots = range(self.frame_logic.SLOTS)
        usage = vk.VK_BUFFER_USAGE_STORAGE_BUFFER_BIT | vk.VK_BUFFER_USAGE_TRANSFER_DST_BIT
        self._counts = [self._buffer(8 * CELLS, usage, "readback", f"counts, slot {slot}") for slot in slots]
        self._sets = [self.set_of(self._draws[0], {0: counts}, "counts") for counts in self._counts]
        info = vk.new(
            "VkQueryPoolCreateInfo",
            queryType=vk.VK_QUERY_TYPE_PIPELINE_STATISTICS,
            queryCount=2 * len(slots),
            pipelineStatistics=vk.VK_QUERY_PIPELINE_STATISTIC_FRAGMENT_SHADER_INVOCATIONS_BIT,
        )
        pool = device.create("vkCreateQueryPool", info, "fragments")
        self._queries = self.keep(pool, lambda pool: device.destroy("VkQueryPool", pool))
        self._before = barriers(memory=(*CLEARED, *COUNTED))
        self._behind = barriers(memory=(*COUNTED, *HOST))

    def create_sized(self) -> None:
        """Choose the push constants of both draws."""
        self._pushed = [push(self.settings, self.size, first) for first in (0, CELLS)]

    def draw(self, commands: Commands, view: View, time: float) -> None:
        """Draw the upper and the lower cells, and count their fragments."""
        fn, slot = self.device.fn, commands.slot.index
        commands.begin_label("clear")
        fn.vkCmdFillBuffer(commands.handle, self._counts[slot].handle, 0, 8 * CELLS, 0)
        fn.vkCmdResetQueryPool(commands.handle, self._queries, 2 * slot, 2)
        commands.end_label()
        commands.barrier(self._before)
        self.begin(commands)
        for number, (pipeline, pushed) in enumerate(zip(self._draws, self._pushed, strict=True)):
            commands.bind_pipeline(pipeline)
            commands.bind_set(pipeline, 0, self._sets[slot])
            commands.push(pipeline, pushed)
            if self._commands:
                fn.vkCmdSetFragmentShadingRateKHR(commands.handle, *self._commands[number])
            fn.vkCmdBeginQuery(commands.handle, self._queries, 2 * slot + number, 0)
            if self.settings.source == "mesh":
                fn.vkCmdDrawMeshTasksEXT(commands.handle, CELLS, 1, 1)
            else:
                fn.vkCmdDraw(commands.handle, 6 * CELLS, 1, 0, 0)
            fn.vkCmdEndQuery(commands.handle, self._queries, 2 * slot + number)
        self.end(commands)
        commands.barrier(self._behind)
        pixels = side_of(self.size) ** 2 * 2 * CELLS
        self.work = RateWork(draws=2, triangles=4 * CELLS, cells=2 * CELLS, pixels=pixels)

    def read_told(self, slot: FrameSlot) -> dict[str, int]:
        """Return how many fragments the slot's frame ran, after a wait for it."""
        self._frames.wait(slot)
        fragments = np.zeros(2, np.uint64)
        flags = vk.VK_QUERY_RESULT_64_BIT | vk.VK_QUERY_RESULT_WAIT_BIT
        place = (self.device.handle, self._queries, 2 * slot.index, 2)
        code = self.device.fn.vkGetQueryPoolResults(*place, 16, vk.ffi.from_buffer(fragments), 8, flags)
        vk.check(code, "vkGetQueryPoolResults")
        counts = self._counts[slot.index]
        self.device.memory.invalidate(counts.allocation)
        self.last_counts = counts.view(np.uint32).reshape(ROWS, COLUMNS).copy()
        return told(fragments, self.last_counts)
