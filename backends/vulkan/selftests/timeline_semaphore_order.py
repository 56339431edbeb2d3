"""Self-test: the GPU waits for a value that the CPU signals, and the CPU for one that the GPU signals."""

from __future__ import annotations

import time

import numpy as np

from backends.vulkan import api as vk
from backends.vulkan.barriers import barriers
from backends.vulkan.selftests.bench import EVERYTHING, UNSET, Bench, differ


def run(bench: Bench) -> str:
    """Return what was wrong, or ""."""
    fn, device = bench.fn, bench.device
    kind = vk.new("VkSemaphoreTypeCreateInfo", semaphoreType=vk.VK_SEMAPHORE_TYPE_TIMELINE, initialValue=4)
    semaphore = bench.make("vkCreateSemaphore", "VkSemaphoreCreateInfo", pNext=kind)
    output = bench.output(16)
    pool = bench.make("vkCreateCommandPool", "VkCommandPoolCreateInfo", queueFamilyIndex=device.queue.family)
    out = vk.ffi.new("VkCommandBuffer[1]")
    info = vk.new("VkCommandBufferAllocateInfo", commandPool=pool, commandBufferCount=1)
    vk.check(fn.vkAllocateCommandBuffers(device.handle, info, out), "vkAllocateCommandBuffers")
    vk.check(fn.vkBeginCommandBuffer(out[0], vk.new("VkCommandBufferBeginInfo")), "vkBeginCommandBuffer")
    fn.vkCmdFillBuffer(out[0], output.handle, 0, 64, 7)
    fn.vkCmdPipelineBarrier2(out[0], barriers(memory=EVERYTHING))
    vk.check(fn.vkEndCommandBuffer(out[0]), "vkEndCommandBuffer")

    def at(value: int) -> dict[str, object]:
        stages = vk.VK_PIPELINE_STAGE_2_ALL_COMMANDS_BIT
        return {"semaphore": semaphore, "value": value, "stageMask": stages}

    submit = vk.new(
        "VkSubmitInfo2",
        pWaitSemaphoreInfos=[at(5)],
        pCommandBufferInfos=[{"commandBuffer": out[0]}],
        pSignalSemaphoreInfos=[at(9)],
    )
    vk.check(fn.vkQueueSubmit2(device.queue.handle, 1, submit, vk.NULL), "vkQueueSubmit2")

    def wait(value: int, nanoseconds: int) -> int:
        info = vk.new("VkSemaphoreWaitInfo", pSemaphores=[semaphore], pValues=[value])
        return vk.check(fn.vkWaitSemaphores(device.handle, info, nanoseconds), "vkWaitSemaphores")

    time.sleep(0.02)  # for a GPU that does not wait to do its work too early
    early = not (bench.read(output, np.uint32) == UNSET).all()
    unsignalled = wait(9, 1_000_000) == vk.VK_TIMEOUT
    info = vk.new("VkSemaphoreSignalInfo", semaphore=semaphore, value=5)
    vk.check(fn.vkSignalSemaphore(device.handle, info), "vkSignalSemaphore")
    if wait(9, 5 * 10**9) == vk.VK_TIMEOUT:
        return "the GPU did not see the value that the CPU signalled"
    if early or not unsignalled:
        return "the GPU did not wait for the value that it was told to wait for"
    value = vk.ffi.new("uint64_t *")
    vk.check(fn.vkGetSemaphoreCounterValue(device.handle, semaphore, value), "vkGetSemaphoreCounterValue")
    if value[0] != 9:
        return f"the semaphore's value is {value[0]} and should be 9"
    return differ("words", bench.read(output, np.uint32), np.full(16, 7, np.uint32))
