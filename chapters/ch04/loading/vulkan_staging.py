"""Memory that the CPU fills and the GPU copies from, and submissions that nobody waits for.

Both are rings. The staging buffer is mapped once and stays mapped; a range of it is used again when the submission that
copies from it has ended. Whether that is so, its fence is asked once a frame. It is reset only when something is about
to be submitted: a fence that was reset for nothing would never be signalled again.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable
from typing import Any

import numpy as np

from backends.vulkan import api as vk
from backends.vulkan.device import Device, Queue
from backends.vulkan.resources import create_buffer, destroy_buffer

from ..frames.frame import SLOTS
from ..frames.vulkan import FOREVER, allocate_commands, create_pool
from .loading import Loading
from .ring import Ring

RING = 8 << 20
"""Bytes of the staging buffer at most. What is larger goes up in parts, and no later for it: a ring that stays in the
processor's cache is written faster than it is copied from."""

MOST_RING = 64 << 20
"""Bytes of it at most where a frame's budget asks for more."""

LEAST_RING = 2 << 20
"""Bytes of it at least: some rows of any image fit, and several small images of a later edit."""


def ring_bytes(loading: Loading) -> int:
    """Return how large a ring is for what is wanted: drivers take long for memory that both sides can reach.

    Where frames are drawn meanwhile, one frame's budget is written while that of the frame before is copied.
    """
    most = max(RING, min(2 * loading.budget, MOST_RING)) if loading.streams else RING
    return min(most, max(LEAST_RING, loading.wanted_bytes))


class Staging:
    """The staging buffer and its ring of ranges."""

    def __init__(self, device: Device, size: int) -> None:
        self._device = device
        self.buffer = create_buffer(
            device, size, vk.VK_BUFFER_USAGE_TRANSFER_SRC_BIT, "upload", "staging ring"
        )
        self._bytes = self.buffer.mapped
        self.ring = Ring(size)

    def alignment(self, texel: int) -> int:
        """Return what offsets of copies are multiples of: whole texels or blocks, 4 bytes, and what the device asks."""
        return math.lcm(texel, 4, int(self._device.limits.optimalBufferCopyOffsetAlignment))

    def write(self, data: np.ndarray, offset: int) -> None:
        """Copy (N,) uint8 into a range; the memory is coherent, so a later submission sees them."""
        self._bytes[offset : offset + data.size] = data

    def close(self) -> None:
        """Free the buffer, which no submission uses any more."""
        destroy_buffer(self._device, self.buffer)


class Submission:
    """A command buffer of a pool of its own, and the fence that says when both can be used again.

    The fence is made signalled, and so the first one begins at once. `mark` and `uploads` are for whoever submits.
    """

    def __init__(self, device: Device, queue: Queue, name: str) -> None:
        self.pool = create_pool(device, queue, name)
        self.commands = allocate_commands(device, self.pool, name)
        signalled = vk.new("VkFenceCreateInfo", flags=vk.VK_FENCE_CREATE_SIGNALED_BIT)
        self.fence = device.create("vkCreateFence", signalled, f"{name} done")
        self.fences = vk.array("VkFence", [self.fence])
        self.sets: Any = None  # the pool of descriptor sets for mip levels, where it has made any
        self.set_count = 0
        self.mark = 0
        self.uploads: list[Any] = []


class Submissions:
    """As many command buffers of one queue as there are frames in flight."""

    def __init__(self, device: Device, queue: Queue, name: str) -> None:
        self._device, self.queue = device, queue
        self._free = deque(Submission(device, queue, f"{name} {number}") for number in range(SLOTS))
        self._flying: deque[Submission] = deque()
        self._begin = vk.new("VkCommandBufferBeginInfo", flags=vk.VK_COMMAND_BUFFER_USAGE_ONE_TIME_SUBMIT_BIT)
        self.count = 0
        """How many were submitted."""

    def collect(self, ended: Callable[[Submission], None]) -> None:
        """Call `ended` for each that the GPU has done since, the oldest first; nothing is waited for."""
        fn, device = self._device.fn, self._device.handle
        while self._flying:
            code = fn.vkGetFenceStatus(device, self._flying[0].fence)
            if vk.check(code, "vkGetFenceStatus") == vk.VK_NOT_READY:
                return
            one = self._flying.popleft()
            self._free.append(one)
            ended(one)

    def rehearse(self, make_sets: Callable[[], Any] | None) -> None:
        """Use each of them once for nothing, and wait: drivers make memory for commands when they first begin.

        `make_sets` makes the pool of descriptor sets, if mip levels will be made.
        """
        for one in list(self._free):
            one.sets = make_sets() if make_sets is not None else None
            self.submit(self.begin())
        while self.flying:
            self.wait()
            self.collect(lambda one: None)
        self.count = 0

    @property
    def ready(self) -> bool:
        """Whether there is one that the GPU does not have."""
        return bool(self._free)

    def begin(self) -> Submission:
        """Return one that is open for recording."""
        one, fn = self._free[0], self._device.fn
        vk.check(fn.vkResetCommandPool(self._device.handle, one.pool, 0), "vkResetCommandPool")
        if one.sets is not None:
            code = fn.vkResetDescriptorPool(self._device.handle, one.sets, 0)
            vk.check(code, "vkResetDescriptorPool")
        vk.check(fn.vkBeginCommandBuffer(one.commands, self._begin), "vkBeginCommandBuffer")
        one.set_count, one.uploads = 0, []
        return one

    def submit(self, one: Submission, wait: Any = None, signal: Any = None) -> None:
        """Submit what `begin` opened; `wait` and `signal` are VkSemaphoreSubmitInfo."""
        fn = self._device.fn
        vk.check(fn.vkEndCommandBuffer(one.commands), "vkEndCommandBuffer")
        submit = vk.new(
            "VkSubmitInfo2",
            pWaitSemaphoreInfos=[wait] if wait is not None else None,
            pCommandBufferInfos=[{"commandBuffer": one.commands}],
            pSignalSemaphoreInfos=[signal] if signal is not None else None,
        )
        vk.check(fn.vkResetFences(self._device.handle, 1, one.fences), "vkResetFences")
        vk.check(fn.vkQueueSubmit2(self.queue.handle, 1, submit, one.fence), "vkQueueSubmit2")
        self._free.popleft()
        self._flying.append(one)
        self.count += 1

    @property
    def flying(self) -> bool:
        """Whether the GPU had not done some of them when they were collected last."""
        return bool(self._flying)

    def wait(self) -> None:
        """Wait for the oldest that was submitted: for loading before the first frame, and for the end."""
        if self._flying:
            fences = self._flying[0].fences
            code = self._device.fn.vkWaitForFences(self._device.handle, 1, fences, 1, FOREVER)
            vk.check(code, "vkWaitForFences")

    def close(self) -> None:
        """Free all of them; the GPU has done them."""
        for one in (*self._free, *self._flying):
            self._device.destroy("VkCommandPool", one.pool)
            self._device.destroy("VkFence", one.fence)
            if one.sets is not None:
                self._device.destroy("VkDescriptorPool", one.sets)
