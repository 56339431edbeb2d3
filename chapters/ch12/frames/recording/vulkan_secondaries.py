"""A pass recorded by several threads, into secondary command buffers that the primary command buffer executes.

A secondary inherits only the formats and samples of its attachments (VkCommandBufferInheritanceRenderingInfo). Each one
sets viewport, scissor, pipeline, sets and index buffer again. The primary begins rendering with a flag for draws that
all come from secondaries. It executes them in the order of the draws, whichever was finished first, so transparent
objects are blended in the right order.

Several threads pay off if a recorded call is short compared with the work of a thread between two calls. In Python the
opposite holds, and the interpreter's lock changes hands at each call as well. So one thread records by default. Fewer
calls help more: `vkCmdDrawIndexedIndirect` is one call for any number of objects.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from backends.vulkan import api as vk
from backends.vulkan.device import Device
from backends.vulkan.resources import FORMATS

from ...pipelines.description import Built
from ...tasks.scheduler import split
from ...tasks.workers import ALONE, Workers
from ..commands import DrawGroup, SceneBinding
from ..settings import FrameSettings
from ..vulkan import Frames, FrameSlot
from ..vulkan_commands import Commands, Rendering
from .parts import DrawList, part_count
from .vulkan_pools import CommandPools

_DRAWS_IN_SECONDARIES = vk.VK_RENDERING_CONTENTS_SECONDARY_COMMAND_BUFFERS_BIT


def open_commands(
    device: Device, frames: Frames, workers: Workers, multi_draw: bool, settings: FrameSettings
) -> Commands:
    """Return the commands of the renderer; they record in parallel if there are workers."""
    if workers.count == 0:
        return Commands(device, multi_draw)
    pools = CommandPools(device, frames.slots, workers)
    return ParallelCommands(device, pools, multi_draw, settings.draws_per_secondary)


class ParallelCommands(Commands):
    """Records as `Commands` does, but several threads record the draws of a pass if there are enough calls."""

    def __init__(self, device: Device, pools: CommandPools, multi_draw: bool, least_calls: int) -> None:
        super().__init__(device, multi_draw)
        self._pools, self._least = pools, least_calls
        self._of_thread = [Commands(device, multi_draw) for _ in range(pools.threads)]
        self._begins: dict[Any, Any] = {}
        self._name = ""
        self._rendering: Rendering
        self._draws = DrawList(multi_draw)

    def begin(self, slot: FrameSlot) -> None:
        """Start recording into `slot`; the GPU has finished with it, and all its secondaries are free again."""
        super().begin(slot)
        self.work |= ALONE
        self._pools.begin(slot)

    # --- draws of a pass, stored until the pass ends ---

    def begin_label(self, name: str) -> None:
        """Open a label; the tasks that record the following draws have its name, too."""
        super().begin_label(name)
        self._name = name

    def begin_rendering(self, rendering: Rendering) -> None:
        """Begin a list of draws to the attachments of `rendering`."""
        self._rendering, self._draws = rendering, DrawList(self._multi_draw)

    def draw_fullscreen(self, pipeline: Built, scene: SceneBinding | None = None) -> None:
        """Store the one triangle of `fullscreen.vert`."""
        self._draws.draw_fullscreen(pipeline, scene, self.sources)

    def draw_groups(self, groups: Sequence[DrawGroup], scene: SceneBinding) -> None:
        """Store groups of draws."""
        self._draws.draw_groups(groups, scene)

    def draw_by(self, record: Callable[[Commands], None]) -> None:
        """Store other draws."""
        self._draws.draw_by(record)

    def end_rendering(self) -> None:
        """Record the stored draws: into this buffer, or with enough calls by all threads into secondaries.

        Raises TaskError if a part could not be recorded, after all threads have stopped. The frame is then lost, and
        the next frame begins anew.
        """
        rendering, parts = self._rendering, part_count(self._draws.calls, self._least)
        buffers = self._record_parts(parts) if parts else None
        info = rendering.info
        info.flags = _DRAWS_IN_SECONDARIES if buffers else 0
        self._fn.vkCmdBeginRendering(self.handle, info)
        if buffers is not None:
            self._fn.vkCmdExecuteCommands(self.handle, len(buffers), vk.array("VkCommandBuffer", buffers))
        else:
            own = self._of_thread[0]
            own.begin(self.slot)
            own.set_area(rendering.size)
            self._draws.record(own, 0, self._draws.calls)
            self._count(own.work)
        super().end_rendering()

    # --- recording in parts ---

    def _record_parts(self, parts: int) -> list[Any]:
        """Return the secondaries of this pass in the order of their draws."""
        draws, pools = self._draws, self._pools
        begin, size = self._inherited(self._rendering), self._rendering.size
        recorded: dict[int, tuple[Any, dict[str, int]]] = {}

        def record(first: int, last: int, thread: int) -> None:
            buffer, commands = pools.take(self.slot), self._of_thread[thread]
            vk.check(self._fn.vkBeginCommandBuffer(buffer, begin), "vkBeginCommandBuffer")
            commands.begin(self.slot)
            commands.handle = buffer
            commands.set_area(size)
            draws.record(commands, first, last)
            vk.check(self._fn.vkEndCommandBuffer(buffer), "vkEndCommandBuffer")
            recorded[first] = buffer, commands.work

        pools.open().share(f"record {self._name}", record, draws.calls, parts)
        ordered = [recorded[first] for first, _ in split(draws.calls, parts)]
        for _, work in ordered:
            self._count(work)
        self._count({"recorded_parts": parts})
        self.work["recording_threads"] = pools.threads
        return [buffer for buffer, _ in ordered]

    def _inherited(self, rendering: Rendering) -> Any:
        """Return the VkCommandBufferBeginInfo of secondaries that draw to attachments of this kind."""
        *colors, depth = rendering.images
        kind = tuple((image.format, image.samples) if image else None for image in rendering.images)
        if kind not in self._begins:
            attachments = vk.new(
                "VkCommandBufferInheritanceRenderingInfo",
                pColorAttachmentFormats=[FORMATS[color.format][0] for color in colors if color] or None,
                depthAttachmentFormat=FORMATS[depth.format][0] if depth else vk.VK_FORMAT_UNDEFINED,
                rasterizationSamples=next(image.samples for image in rendering.images if image),
            )
            self._begins[kind] = vk.new(
                "VkCommandBufferBeginInfo",
                flags=vk.VK_COMMAND_BUFFER_USAGE_RENDER_PASS_CONTINUE_BIT,
                pInheritanceInfo=vk.new("VkCommandBufferInheritanceInfo", pNext=attachments),
            )
        return self._begins[kind]

    def _count(self, work: dict[str, int]) -> None:
        for name, number in work.items():
            self.work[name] += number

    def close(self) -> None:
        """Free the pools, after the GPU has finished with all slots and the threads have ended."""
        self._pools.close()
