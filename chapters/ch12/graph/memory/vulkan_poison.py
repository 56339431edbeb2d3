"""Fills memory with impossible values before its first use in a frame: a tool that finds missing writes.

A pass that reads memory which no pass of this frame wrote mostly gets the values of the previous frame. The picture
looks right until another resource uses the memory. With poison it looks wrong at once: NaN spreads through every
result, and an integer of all ones is no valid index. Depth is 0 or 1, since Vulkan allows no other.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from backends.vulkan import api as vk
from backends.vulkan.resources import Buffer, Image

from ...frames.queues.vulkan_queues import Queues
from ...frames.vulkan_commands import Commands
from ..sync.vulkan import dependency
from ..types import Barrier, Touch

_FILLED = Touch("copy_target", frozenset({"copy"}), frozenset({"copy_write"}), writes=True)


class Poison:
    """The work before one step: its barriers, with a fill of each resource whose life begins there."""

    def __init__(
        self, queues: Queues, planned: Sequence[Barrier], objects: Mapping[str, Image | Buffer], choice: str
    ) -> None:
        self._fn, taking = queues.device.fn, queues.taking
        new = [barrier for barrier in planned if barrier.discard]
        filled = [replace(barrier, after=_of(barrier, _FILLED)) for barrier in new]
        self._before = dependency(filled, objects, taking)
        self._after = dependency(
            [
                replace(barrier, before=_of(barrier, _FILLED), discard=False, instead_of=())
                if barrier.discard
                else barrier
                for barrier in planned
            ],
            objects,
            taking,
        )
        self._fills = [self._fill(objects[barrier.resource], choice) for barrier in new]

    def _fill(self, resource: Image | Buffer, choice: str) -> tuple[Any, ...]:
        if isinstance(resource, Buffer):
            return (self._fn.vkCmdFillBuffer, resource.handle, 0, vk.VK_WHOLE_SIZE, 0xFFFFFFFF)
        whole = vk.new(
            "VkImageSubresourceRange",
            aspectMask=resource.aspect,
            levelCount=vk.VK_REMAINING_MIP_LEVELS,
            layerCount=vk.VK_REMAINING_ARRAY_LAYERS,
        )
        target = vk.VK_IMAGE_LAYOUT_TRANSFER_DST_OPTIMAL
        if resource.aspect == vk.VK_IMAGE_ASPECT_DEPTH_BIT:
            value = vk.new("VkClearDepthStencilValue", depth=float(choice.removeprefix("depth ")))
            return (self._fn.vkCmdClearDepthStencilImage, resource.handle, target, value, 1, whole)
        whole_number = resource.format.endswith("ui")
        filled = {"uint32": [0xFFFFFFFF] * 4} if whole_number else {"float32": [float("nan")] * 4}
        value = vk.new("VkClearColorValue", **filled)
        return (self._fn.vkCmdClearColorImage, resource.handle, target, value, 1, whole)

    def record(self, commands: Commands) -> None:
        """Record the fills and the step's barriers."""
        if self._before is not None:
            commands.barrier(self._before)
        for call, *arguments in self._fills:
            call(commands.handle, *arguments)
        if self._after is not None:
            commands.barrier(self._after)


def _of(barrier: Barrier, touch: Touch) -> Touch:
    return touch if barrier.after.layout else replace(touch, layout="")
