"""The study primaries on Vulkan: each part of the squares in a primary of its own, by the thread that comes first."""

from __future__ import annotations

from typing import Any

from backends.vulkan import api as vk
from backends.vulkan.barriers import barriers, image_barrier
from common.view.camera import View

from ...frames.recording.vulkan_pools import CommandPools
from ...frames.vulkan import Frames, FrameSlot
from ...frames.vulkan_commands import Commands, Rendering
from ...pipelines.description import PipelineDescription
from ...tasks.scheduler import split
from ...tasks.workers import Workers
from ..stage_vulkan import Stage
from . import SHADERS, SQUARES, STUDY, Settings


class ManyPrimaries(Frames):
    """Frames whose slots may be given another last primary, and a submission of several, for one frame."""

    def submit(self, slot: FrameSlot) -> None:
        """Submit the frame, and give the slot back what it had."""
        super().submit(slot)
        slot.commands, slot.submit = getattr(slot, "before", (slot.commands, slot.submit))


class Renderer(Stage):
    """Squares over one another, recorded in parts."""

    study = STUDY
    settings_class: type = Settings
    graphics = Stage.graphics._replace(frames=ManyPrimaries)
    moves = False

    def create(self) -> None:
        """Make the pipeline, and a pool of primaries for each frame slot and thread."""
        described = PipelineDescription(SHADERS, color="rgba8", depth=None, blend="over", name=STUDY.title)
        self._pipeline = self.pipelines.get([described])[0]
        self._workers = self.keep(Workers(self.settings.threads), Workers.close)
        slots, primary = self._frames.slots, vk.VK_COMMAND_BUFFER_LEVEL_PRIMARY
        self._pools = self.keep(CommandPools(self.device, slots, self._workers, primary), CommandPools.close)
        self._pools.open()
        self._begin_info = vk.new(
            "VkCommandBufferBeginInfo", flags=vk.VK_COMMAND_BUFFER_USAGE_ONE_TIME_SUBMIT_BIT
        )

    def draw(self, commands: Commands, view: View, time: float) -> None:
        """Clear the picture in the slot's primary, draw in others, and end the frame in a last one."""
        fn, slot = self.device.fn, commands.slot
        self._pools.begin(slot)
        self.begin(commands)
        self.end(commands)
        # Rendering begins anew in each primary: on what the ones before have left, and after them.
        over = Rendering(self.size, self.picture, None)
        after = barriers(image_barrier(self.picture.handle, self.picture.aspect, "color", "color"))
        recorded: dict[int, Any] = {}

        def record(first: int, last: int, thread: int) -> None:
            own = Commands(self.device)
            own.begin(slot)
            own.handle = self._open_primary(slot)
            own.barrier(after)
            own.begin_rendering(over)
            own.bind_pipeline(self._pipeline)
            fn.vkCmdDraw(own.handle, 6, last - first, 0, first)
            own.end_rendering()
            vk.check(fn.vkEndCommandBuffer(own.handle), "vkEndCommandBuffer")
            recorded[first] = own.handle

        count = self.settings.primaries
        self._workers.share("record squares", record, SQUARES, count)
        parts = [recorded[first] for first, _ in split(SQUARES, count)]
        if self.settings.order == "reversed":
            parts.reverse()
        vk.check(fn.vkEndCommandBuffer(slot.commands), "vkEndCommandBuffer")
        before: Any = slot
        before.before = slot.commands, slot.submit
        last = self._open_primary(slot)
        order = [{"commandBuffer": handle} for handle in (slot.commands, *parts, last)]
        slot.commands = commands.handle = last
        slot.submit = vk.new("VkSubmitInfo2", pCommandBufferInfos=order)
        self.work.draws, self.work.triangles = count, 2 * SQUARES

    def _open_primary(self, slot: FrameSlot) -> Any:
        """Return a primary from the pool of the thread that asks, begun."""
        buffer = self._pools.take(slot)
        vk.check(self.device.fn.vkBeginCommandBuffer(buffer, self._begin_info), "vkBeginCommandBuffer")
        return buffer
