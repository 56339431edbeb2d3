"""Command pools, one per frame slot and thread: who has a pool of its own needs no lock to record.

A pool, and every command buffer from it, may be used by one thread at a time, and must not be reset while the GPU may
still read a buffer from it. Hence frames x threads pools. When a slot is used again its pools are reset as a whole,
which keeps their memory and makes all their buffers ready at once: none is ever freed, and after the first frames none
is allocated either.
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
    """A pool with its buffers of one level, of which the first `used` are given out."""

    def __init__(self, device: Device, handle: Any, name: str, level: int) -> None:
        self.handle = handle
        self.used = 0
        self._device, self._name, self._level = device, name, level
        self._buffers: list[Any] = []

    def take(self) -> Any:
        """Return a buffer that nobody has used since the pool was reset."""
        if self.used == len(self._buffers):
            name = f"{self._name}, buffer {self.used}"
            self._buffers.append(allocate_commands(self._device, self.handle, name, self._level))
        self.used += 1
        return self._buffers[self.used - 1]


class CommandPools:
    """The pools of all frame slots and of the threads that record: the renderer's own and its workers.

    Thread 0, which records the frame itself, has that of the slot, where the primary buffer comes from, too.
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
        """By `pool_index`; none before `open`."""

    def open(self) -> Workers:
        """Return the threads that may take buffers; they get their pools at the first time."""
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
        """Reset the pools of a slot whose last frame the GPU has finished: `Frames.begin` has waited for it.

        That of thread 0 it has reset as well.
        """
        fn, device = self._device.fn, self._device.handle
        for thread in range(self.threads if self.pools else 0):
            pool = self.pools[pool_index(slot.index, thread, self.threads)]
            if pool.used and thread > 0:
                vk.check(fn.vkResetCommandPool(device, pool.handle, 0), "vkResetCommandPool")
            pool.used = 0

    def take(self, slot: FrameSlot) -> Any:
        """Return a buffer for this frame from the pool of the thread that asks.

        RuntimeError if it is none of the scheduler's, ValueError if it has no pool here (a pinned one).
        """
        return self.pools[pool_index(slot.index, self._workers.tasks.thread, self.threads)].take()

    def close(self) -> None:
        """Free the pools, after the GPU has left all slots."""
        for handle in self._own:
            self._device.destroy("VkCommandPool", handle)
        self._own.clear()
