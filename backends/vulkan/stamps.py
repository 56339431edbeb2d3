"""When each submission began and ended on the GPU, by queue, and for how long two lists of such intervals overlap.

Every command buffer that is recorded gets a stamp as its first command and one as its last, by watches in the place of
the device's functions: the renderer knows nothing of it. Stamps of all queues of a device count the same clock.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from backends.vulkan import api as vk
from backends.vulkan.device import Device, Queue
from backends.vulkan.once import submit_once

STAMPS = 1 << 14
"""Two for each command buffer; what is recorded after them goes unseen."""

Interval = tuple[float, float]


class Stamps:
    """Watches a device from its making on; `timeline` says what ran when. A renderer is made and closed meanwhile."""

    def __init__(self, device: Device) -> None:
        self._device = device
        info = vk.new("VkQueryPoolCreateInfo", queryType=vk.VK_QUERY_TYPE_TIMESTAMP, queryCount=STAMPS)
        self._pool = device.create("vkCreateQueryPool", info, "stamps of submissions")
        with submit_once(device) as commands:
            device.fn.vkCmdResetQueryPool(commands, self._pool, 0, STAMPS)
        self._open: dict[Any, int] = {}  # what is being recorded -> its first stamp
        self._stamped: dict[Any, int] = {}
        self._submitted: list[tuple[Any, int]] = []  # (queue, first stamp)
        self._next = 0
        fn: Any = device.fn
        self._begin, self._end, self._submit = (
            fn.vkBeginCommandBuffer,
            fn.vkEndCommandBuffer,
            fn.vkQueueSubmit2,
        )
        fn.vkBeginCommandBuffer, fn.vkEndCommandBuffer = self._begun, self._ended
        fn.vkQueueSubmit2 = self._sent

    def _begun(self, commands: Any, info: Any) -> int:
        code: int = self._begin(commands, info)
        if self._next + 2 <= STAMPS and info.pInheritanceInfo == vk.NULL:
            self._stamp(commands, self._next)
            self._open[commands] = self._next
            self._next += 2
        return code

    def _ended(self, commands: Any) -> int:
        first = self._open.pop(commands, None)
        if first is not None:
            self._stamp(commands, first + 1)
            self._stamped[commands] = first
        code: int = self._end(commands)
        return code

    def _sent(self, queue: Any, count: int, submits: Any, fence: Any) -> int:
        for number in range(count):
            one = submits[number]
            for place in range(one.commandBufferInfoCount):
                first = self._stamped.pop(one.pCommandBufferInfos[place].commandBuffer, None)
                if first is not None:
                    self._submitted.append((queue, first))
        code: int = self._submit(queue, count, submits, fence)
        return code

    def _stamp(self, commands: Any, query: int) -> None:
        stage = vk.VK_PIPELINE_STAGE_2_ALL_COMMANDS_BIT
        self._device.fn.vkCmdWriteTimestamp2(commands, stage, self._pool, query)

    def timeline(self) -> dict[str, list[Interval]]:
        """Return (begin, end) in ms of all submissions, by queue, in their order; waits for the device."""
        device = self._device
        device.wait_idle()
        stamps = np.zeros(max(self._next, 1), np.uint64)
        if self._next:
            code = device.fn.vkGetQueryPoolResults(
                device.handle,
                self._pool,
                0,
                self._next,
                stamps.nbytes,
                vk.ffi.from_buffer(stamps),
                8,
                vk.VK_QUERY_RESULT_64_BIT,
            )
            vk.check(code, "vkGetQueryPoolResults")
        period = float(device.limits.timestampPeriod) * 1e-6
        origin = min((int(stamps[first]) for _, first in self._submitted), default=0)
        found: dict[str, list[Interval]] = {}
        for queue, first in self._submitted:
            begin, end = (
                (int(stamps[first]) - origin) * period,
                (int(stamps[first + 1]) - origin) * period,
            )
            found.setdefault(self._name(queue), []).append((begin, end))
        return found

    def _name(self, queue: Any) -> str:
        named: list[tuple[str, Queue | None]] = [
            ("transfer", self._device.transfer_queue),
            ("compute", self._device.compute_queue),
            ("graphics", self._device.queue),
        ]
        return next(name for name, one in named if one is not None and one.handle == queue)

    def close(self) -> None:
        """Take the watches away, and free the stamps."""
        fn: Any = self._device.fn
        fn.vkBeginCommandBuffer, fn.vkEndCommandBuffer = self._begin, self._end
        fn.vkQueueSubmit2 = self._submit
        self._device.wait_idle()
        self._device.destroy("VkQueryPool", self._pool)


def can_stamp(device: Device) -> bool:
    """Whether every queue that is used has timestamps."""
    queues = [device.queue, *([device.transfer_queue] if device.transfer_queue is not None else [])]
    return all(device.physical.families[queue.family].timestamp_bits for queue in queues)


def merged(intervals: Sequence[Interval]) -> list[Interval]:
    """Return the union of intervals as intervals that lie apart, in order."""
    made: list[Interval] = []
    for begin, end in sorted(intervals):
        if made and begin <= made[-1][1]:
            made[-1] = made[-1][0], max(made[-1][1], end)
        else:
            made.append((begin, end))
    return made


def common_ms(one: Sequence[Interval], other: Sequence[Interval]) -> float:
    """Return for how long something of both ran at the same time."""
    first, second = merged(one), merged(other)
    total, place = 0.0, 0
    for begin, end in first:
        while place < len(second) and second[place][1] <= begin:
            place += 1
        number = place
        while number < len(second) and second[number][0] < end:
            total += min(end, second[number][1]) - max(begin, second[number][0])
            number += 1
    return total
