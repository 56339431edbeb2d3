"""Command pools, one per frame slot and thread, so that threads record without locks.

Only one thread at a time may use a pool and its command buffers. A pool must not be reset while the GPU may still read
one of its buffers. Hence there are frames x threads pools. When a slot is used again, its pools are reset as a whole,
which keeps their memory and makes all their buffers available at once. No buffer is freed, and none is allocated after
the first frames.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from backends.vulkan import api as vk
from backends.vulkan.device import Device

from ...tasks.workers import Workers
from ..vulkan import FrameSlot, allocate_commands, create_pool
from .parts import pool_index


class CommandPool:
    """A pool with its buffers of one level; the first `used` buffers are in use."""

    def __init__(self, device: Device, handle: Any, name: str, level: int) -> None:
        self.handle = handle
        self.used = 0
        self._device, self._name, self._level = device, name, level
        self._buffers: list[Any] = []

    def take(self) -> Any:
        """Return a buffer that is unused since the last reset of the pool."""
        if self.used == len(self._buffers):
            name = f"{self._name}, buffer {self.used}"
            self._buffers.append(allocate_commands(self._device, self.handle, name, self._level))
        self.used += 1
        return self._buffers[self.used - 1]


class CommandPools:
    """The pools of all frame slots and of the threads that record: the renderer's own and its workers.

    Thread 0 records the frame itself. It uses the pool of the slot, which the primary buffer comes from, too.
    """

    def __init__(
        self,
        device: Device,
        slots: Sequence[FrameSlot],
        workers: Workers,
        level: int = vk.VK_COMMAND_BUFFER_LEVEL_SECONDARY,
    ) -> None:
        self._level = level
        self._device, self._slots, self._workers = device, slots, workers
        self._own: list[Any] = []
        self.threads = 1 + workers.count
        self.pools: list[CommandPool] = []
        """The pools by `pool_index`; empty before `open`."""

    def open(self) -> Workers:
        """Return the threads that may take buffers; the first call creates their pools."""
        device = self._device
        for number in range(len(self.pools), len(self._slots) * self.threads):
            slot, thread = self._slots[number // self.threads], number % self.threads
            name, handle = f"frame slot {slot.index}, thread {thread}", slot.pool
            if thread > 0:
                handle = create_pool(device, device.queue, name)
                self._own.append(handle)
            self.pools.append(CommandPool(device, handle, name, self._level))
        return self._workers

    def begin(self, slot: FrameSlot) -> None:
        """Reset the pools of a slot after the GPU has finished its last frame.

        `Frames.begin` has waited for that frame, and has reset the pool of thread 0.
        """
        fn, device = self._device.fn, self._device.handle
        for thread in range(self.threads if self.pools else 0):
            pool = self.pools[pool_index(slot.index, thread, self.threads)]
            if pool.used and thread > 0:
                vk.check(fn.vkResetCommandPool(device, pool.handle, 0), "vkResetCommandPool")
            pool.used = 0

    def take(self, slot: FrameSlot) -> Any:
        """Return a buffer for this frame from the pool of the calling thread.

        RuntimeError if the thread is not one of the scheduler's, ValueError if it has no pool here (a pinned thread).
        """
        return self.pools[pool_index(slot.index, self._workers.tasks.thread, self.threads)].take()

    def close(self) -> None:
        """Free the pools, after the GPU has finished with all slots."""
        for handle in self._own:
            self._device.destroy("VkCommandPool", handle)
        self._own.clear()
