"""GPU times of passes: a timestamp before and after each pass, read when the frame is finished.

Each slot has its own query pool, so the CPU reads the timestamps of one frame while the GPU writes those of the next.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from backends.vulkan import api as vk
from backends.vulkan.device import Device, Queue

from .frame import SLOTS
from .vulkan import FrameSlot

CAPACITY = 64
"""The largest number of passes in a frame."""


class Profiler:
    """Timestamps around passes; `read` returns their differences in milliseconds."""

    def __init__(self, device: Device, queue: Queue | None = None) -> None:
        self._device = device
        self._period_ms = float(device.limits.timestampPeriod) * 1e-6
        bits = device.physical.families[(queue or device.queue).family].timestamp_bits
        self.available = bits > 0 and self._period_ms > 0
        self._mask = (1 << bits) - 1
        self._names: list[list[str]] = [[] for _ in range(SLOTS)]
        self._pools: list[Any] = []
        if self.available:
            info = vk.new(
                "VkQueryPoolCreateInfo", queryType=vk.VK_QUERY_TYPE_TIMESTAMP, queryCount=2 * CAPACITY
            )
            self._pools = [
                device.create("vkCreateQueryPool", info, f"timestamps of slot {index}")
                for index in range(SLOTS)
            ]

    def begin_frame(self, slot: FrameSlot) -> None:
        """Reset the slot's timestamps."""
        self._names[slot.index] = []
        if self.available:
            self._device.fn.vkCmdResetQueryPool(slot.commands, self._pools[slot.index], 0, 2 * CAPACITY)

    def begin(self, slot: FrameSlot, name: str) -> None:
        """Write the timestamp before pass `name`."""
        names = self._names[slot.index]
        names.append(name)
        self._stamp(slot, 2 * len(names) - 2, vk.VK_PIPELINE_STAGE_2_ALL_COMMANDS_BIT)

    def end(self, slot: FrameSlot) -> None:
        """Write the timestamp after the pass that began last."""
        self._stamp(slot, 2 * len(self._names[slot.index]) - 1, vk.VK_PIPELINE_STAGE_2_ALL_COMMANDS_BIT)

    def _stamp(self, slot: FrameSlot, query: int, stage: int) -> None:
        if self.available:
            self._device.fn.vkCmdWriteTimestamp2(slot.commands, stage, self._pools[slot.index], query)

    def read(self, slot: FrameSlot) -> dict[str, float]:
        """Return milliseconds by pass of the slot's finished frame; empty if the device has no timestamps."""
        names = self._names[slot.index]
        if not self.available or not names:
            return {}
        stamps = np.zeros(2 * len(names), np.uint64)
        code = self._device.fn.vkGetQueryPoolResults(
            self._device.handle,
            self._pools[slot.index],
            0,
            len(stamps),
            stamps.nbytes,
            vk.ffi.from_buffer(stamps),
            8,
            vk.VK_QUERY_RESULT_64_BIT,
        )
        if vk.check(code, "vkGetQueryPoolResults") == vk.VK_NOT_READY:
            return {}
        # A counter of fewer than 64 bits wraps around; the masked difference is still right.
        ticks = [(int(stamps[2 * i + 1]) - int(stamps[2 * i])) & self._mask for i in range(len(names))]
        return {name: count * self._period_ms for name, count in zip(names, ticks, strict=True)}

    def close(self) -> None:
        """Free the query pools."""
        for pool in self._pools:
            self._device.destroy("VkQueryPool", pool)
