"""How many fragments the shaders of some draws have run, as the device counts them, on Vulkan and on OpenGL."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np


@contextmanager
def fragments(device: Any) -> Iterator[tuple[Callable[[Any], Any], Callable[[], int]]]:
    """Give a context to record draws in, called with their commands, and what reads how many fragments they shaded."""
    if device.capabilities.backend == "gl":
        from backends.gl.queries import Statistics

        statistics = Statistics(device, "shaded")
        try:
            yield lambda commands: statistics.count(), lambda: statistics.read()["fragment_invocations"]
        finally:
            statistics.close()
        return
    from backends.vulkan import api as vk

    fn, handle = device.fn, device.handle
    info = vk.new(
        "VkQueryPoolCreateInfo",
        queryType=vk.VK_QUERY_TYPE_PIPELINE_STATISTICS,
        queryCount=1,
        pipelineStatistics=vk.VK_QUERY_PIPELINE_STATISTIC_FRAGMENT_SHADER_INVOCATIONS_BIT,
    )
    pool = device.create("vkCreateQueryPool", info, "shaded fragments")
    fn.vkResetQueryPool(handle, pool, 0, 1)

    @contextmanager
    def counting(commands: Any) -> Iterator[None]:
        fn.vkCmdBeginQuery(commands.handle, pool, 0, 0)
        yield
        fn.vkCmdEndQuery(commands.handle, pool, 0)

    def read() -> int:
        counts = np.zeros(1, np.uint64)
        flags = vk.VK_QUERY_RESULT_64_BIT | vk.VK_QUERY_RESULT_WAIT_BIT
        into = vk.ffi.from_buffer(counts)
        code = fn.vkGetQueryPoolResults(handle, pool, 0, 1, counts.nbytes, into, counts.nbytes, flags)
        vk.check(code, "vkGetQueryPoolResults")
        return int(counts[0])

    try:
        yield counting, read
    finally:
        device.wait_idle()
        device.destroy("VkQueryPool", pool)
