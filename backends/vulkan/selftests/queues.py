"""A buffer that goes from the graphics queue to another one and back, for the self-tests of queues."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from backends.vulkan import api as vk
from backends.vulkan.barriers import barriers
from backends.vulkan.device import Queue
from backends.vulkan.resources import Buffer, create_buffer, destroy_buffer
from backends.vulkan.selftests.bench import BUFFER_USAGE, EVERYTHING, Bench, differ
from common.errors import UnsupportedError

WORDS = 4096

Work = Callable[[Any, Buffer], Buffer]
"""Records work on a buffer, and returns the buffer that holds its result."""


def hand_over(
    bench: Bench, other: Queue | None, work: Work, expected: Callable[[np.ndarray], np.ndarray]
) -> str:
    """Return "" if `other` gives back what `expected` makes of the words that the graphics queue wrote.

    Three submissions, one after the other by a timeline semaphore; the buffer changes its owner between them.
    """
    if other is None:
        raise UnsupportedError("The device has no such queue.")
    device, graphics = bench.device, bench.device.queue
    data = np.random.default_rng(3).integers(0, 2**31, WORDS, dtype=np.uint32)
    source, output = bench.input(data), bench.output(WORDS)
    shared = create_buffer(device, 4 * WORDS, BUFFER_USAGE, "device", "shared")
    bench.at_end(destroy_buffer, device, shared)
    kind = vk.new("VkSemaphoreTypeCreateInfo", semaphoreType=vk.VK_SEMAPHORE_TYPE_TIMELINE)
    timeline = bench.make("vkCreateSemaphore", "VkSemaphoreCreateInfo", pNext=kind)
    results: list[Buffer] = []

    def write(commands: Any) -> None:
        copy(bench, commands, source, shared)
        _give(bench, commands, shared, graphics, other)

    def use(commands: Any) -> None:
        _give(bench, commands, shared, graphics, other)
        results.append(work(commands, shared))
        _give(bench, commands, results[0], other, graphics)

    def read(commands: Any) -> None:
        _give(bench, commands, results[0], other, graphics)
        copy(bench, commands, results[0], output)
        bench.fn.vkCmdPipelineBarrier2(commands, barriers(memory=EVERYTHING))

    for step, (queue, record) in enumerate(((graphics, write), (other, use), (graphics, read))):
        _submit(bench, queue, record, timeline, step)
    wait = vk.new("VkSemaphoreWaitInfo", pSemaphores=[timeline], pValues=[3])
    code = bench.fn.vkWaitSemaphores(device.handle, wait, 10 * 10**9)
    if vk.check(code, "vkWaitSemaphores") == vk.VK_TIMEOUT:
        return "the queues did not finish within 10 s"
    return differ("words", bench.read(output, np.uint32), expected(data))


def copy(bench: Bench, commands: Any, source: Buffer, target: Buffer) -> None:
    """Record a copy of a whole buffer."""
    region = vk.new("VkBufferCopy", size=4 * WORDS)
    bench.fn.vkCmdCopyBuffer(commands, source.handle, target.handle, 1, region)


def _give(bench: Bench, commands: Any, buffer: Buffer, giver: Queue, taker: Queue) -> None:
    """Record the half of a change of ownership that belongs to the queue of `commands`: both halves read the same."""
    stages, writes = EVERYTHING[:2]
    same = giver.family == taker.family
    ignored = vk.VK_QUEUE_FAMILY_IGNORED
    barrier = vk.new(
        "VkBufferMemoryBarrier2",
        srcStageMask=stages,
        srcAccessMask=writes,
        dstStageMask=stages,
        dstAccessMask=vk.VK_ACCESS_2_MEMORY_READ_BIT | vk.VK_ACCESS_2_MEMORY_WRITE_BIT,
        srcQueueFamilyIndex=ignored if same else giver.family,
        dstQueueFamilyIndex=ignored if same else taker.family,
        buffer=buffer.handle,
        size=vk.VK_WHOLE_SIZE,
    )
    bench.fn.vkCmdPipelineBarrier2(commands, vk.new("VkDependencyInfo", pBufferMemoryBarriers=[barrier]))


def _submit(bench: Bench, queue: Queue, record: Callable[[Any], None], timeline: Any, step: int) -> None:
    """Submit recorded commands that wait for the timeline's value `step` and signal the next."""
    fn, device = bench.fn, bench.device
    pool = bench.make("vkCreateCommandPool", "VkCommandPoolCreateInfo", queueFamilyIndex=queue.family)
    out = vk.ffi.new("VkCommandBuffer[1]")
    info = vk.new("VkCommandBufferAllocateInfo", commandPool=pool, commandBufferCount=1)
    vk.check(fn.vkAllocateCommandBuffers(device.handle, info, out), "vkAllocateCommandBuffers")
    vk.check(fn.vkBeginCommandBuffer(out[0], vk.new("VkCommandBufferBeginInfo")), "vkBeginCommandBuffer")
    record(out[0])
    vk.check(fn.vkEndCommandBuffer(out[0]), "vkEndCommandBuffer")
    point = {"semaphore": timeline, "stageMask": vk.VK_PIPELINE_STAGE_2_ALL_COMMANDS_BIT}
    submit = vk.new(
        "VkSubmitInfo2",
        pWaitSemaphoreInfos=[{**point, "value": step}],
        pCommandBufferInfos=[{"commandBuffer": out[0]}],
        pSignalSemaphoreInfos=[{**point, "value": step + 1}],
    )
    vk.check(fn.vkQueueSubmit2(queue.handle, 1, submit, vk.NULL), "vkQueueSubmit2")
