"""The staging buffer, and submissions of copies that the CPU does not wait for.

Both are rings. The staging buffer stays mapped; a range of it is used again when the submission that copies from it has
ended. The fence of each submission is polled once a frame. A fence is reset only directly before its next submission: a
fence that was reset without one would never be signalled again.
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
"""The most bytes of the staging buffer. Larger images are copied in parts, which costs no time: a ring that fits into
the processor's cache is written faster than the GPU copies from it."""

MOST_RING = 64 << 20
"""The most bytes if a frame's budget needs more."""

LEAST_RING = 2 << 20
"""The least bytes: enough for some rows of any image, and for several small images of a later edit."""


def ring_bytes(loading: Loading) -> int:
    """Return the size of the ring for the wanted textures: allocating memory that CPU and GPU share is slow.

    If frames are drawn meanwhile, the budget of one frame is written while that of the previous frame is copied.
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
        """Return the alignment of copies: whole texels or blocks, 4 bytes, and the device's own alignment."""
        return math.lcm(texel, 4, int(self._device.limits.optimalBufferCopyOffsetAlignment))

    def write(self, data: np.ndarray, offset: int) -> None:
        """Copy (N,) uint8 into a range; the memory is coherent, so a later submission sees them."""
        self._bytes[offset : offset + data.size] = data

    def close(self) -> None:
        """Free the buffer; no submission uses it."""
        destroy_buffer(self._device, self.buffer)


class Submission:
    """A command buffer with its own pool, and the fence that signals when both can be used again.

    The fence is created signalled, so the first use does not wait. `mark` and `uploads` are data of the caller.
    """

    def __init__(self, device: Device, queue: Queue, name: str) -> None:
        self.pool = create_pool(device, queue, name)
        self.commands = allocate_commands(device, self.pool, name)
        signalled = vk.new("VkFenceCreateInfo", flags=vk.VK_FENCE_CREATE_SIGNALED_BIT)
        self.fence = device.create("vkCreateFence", signalled, f"{name} done")
        self.fences = vk.array("VkFence", [self.fence])
        self.sets: Any = None  # the descriptor pool for mip levels, if it made any
        self.set_count = 0
        self.mark = 0
        self.uploads: list[Any] = []


class Submissions:
    """The command buffers of one queue, one for each frame in flight."""

    def __init__(self, device: Device, queue: Queue, name: str) -> None:
        self._device, self.queue = device, queue
        self._free = deque(Submission(device, queue, f"{name} {number}") for number in range(SLOTS))
        self._flying: deque[Submission] = deque()
        self._begin = vk.new("VkCommandBufferBeginInfo", flags=vk.VK_COMMAND_BUFFER_USAGE_ONE_TIME_SUBMIT_BIT)
        self.count = 0
        """The number of submissions."""

    def collect(self, ended: Callable[[Submission], None]) -> None:
        """Call `ended` for each submission that the GPU has finished, the oldest first, without waiting."""
        fn, device = self._device.fn, self._device.handle
        while self._flying:
            code = fn.vkGetFenceStatus(device, self._flying[0].fence)
            if vk.check(code, "vkGetFenceStatus") == vk.VK_NOT_READY:
                return
            submission = self._flying.popleft()
            self._free.append(submission)
            ended(submission)

    def rehearse(self, make_sets: Callable[[], Any] | None) -> None:
        """Submit each command buffer once without commands, and wait: drivers allocate memory at their first use.

        `make_sets` creates the descriptor pool, if mip levels will be made.
        """
        for free in list(self._free):
            free.sets = make_sets() if make_sets is not None else None
            self.submit(self.begin())
        while self.flying:
            self.wait()
            self.collect(lambda submission: None)
        self.count = 0

    @property
    def ready(self) -> bool:
        """Whether a command buffer is free."""
        return bool(self._free)

    def begin(self) -> Submission:
        """Return a free command buffer, open for recording."""
        submission, fn = self._free[0], self._device.fn
        vk.check(fn.vkResetCommandPool(self._device.handle, submission.pool, 0), "vkResetCommandPool")
        if submission.sets is not None:
            code = fn.vkResetDescriptorPool(self._device.handle, submission.sets, 0)
            vk.check(code, "vkResetDescriptorPool")
        vk.check(fn.vkBeginCommandBuffer(submission.commands, self._begin), "vkBeginCommandBuffer")
        submission.set_count, submission.uploads = 0, []
        return submission

    def submit(self, submission: Submission, wait: Any = None, signal: Any = None) -> None:
        """Submit what `begin` opened; `wait` and `signal` are VkSemaphoreSubmitInfo."""
        fn = self._device.fn
        vk.check(fn.vkEndCommandBuffer(submission.commands), "vkEndCommandBuffer")
        submit = vk.new(
            "VkSubmitInfo2",
            pWaitSemaphoreInfos=[wait] if wait is not None else None,
            pCommandBufferInfos=[{"commandBuffer": submission.commands}],
            pSignalSemaphoreInfos=[signal] if signal is not None else None,
        )
        vk.check(fn.vkResetFences(self._device.handle, 1, submission.fences), "vkResetFences")
        vk.check(fn.vkQueueSubmit2(self.queue.handle, 1, submit, submission.fence), "vkQueueSubmit2")
        self._free.popleft()
        self._flying.append(submission)
        self.count += 1

    @property
    def flying(self) -> bool:
        """Whether some submissions were not finished at the last `collect`."""
        return bool(self._flying)

    def wait(self) -> None:
        """Wait for the oldest submission: used before the first frame, and at the end."""
        if self._flying:
            fences = self._flying[0].fences
            code = self._device.fn.vkWaitForFences(self._device.handle, 1, fences, 1, FOREVER)
            vk.check(code, "vkWaitForFences")

    def close(self) -> None:
        """Free all; the GPU has finished them."""
        for submission in (*self._free, *self._flying):
            self._device.destroy("VkCommandPool", submission.pool)
            self._device.destroy("VkFence", submission.fence)
            if submission.sets is not None:
                self._device.destroy("VkDescriptorPool", submission.sets)
