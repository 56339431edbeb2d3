"""Statistics queries for the self-tests: a pool of one query, read as {bit: count}."""

from __future__ import annotations

from typing import Any

import numpy as np

from backends.vulkan import api as vk
from backends.vulkan.selftests.bench import Bench


class Statistics:
    """One pipeline-statistics query for the bits of `flags`, reset and ready to begin."""

    def __init__(self, bench: Bench, flags: int) -> None:
        self._bench, self._flags = bench, flags
        self.pool = bench.make(
            "vkCreateQueryPool",
            "VkQueryPoolCreateInfo",
            queryType=vk.VK_QUERY_TYPE_PIPELINE_STATISTICS,
            queryCount=1,
            pipelineStatistics=flags,
        )
        bench.fn.vkResetQueryPool(bench.device.handle, self.pool, 0, 1)

    def begin(self, commands: Any) -> None:
        """Record the begin of counting."""
        self._bench.fn.vkCmdBeginQuery(commands, self.pool, 0, 0)

    def end(self, commands: Any) -> None:
        """Record its end."""
        self._bench.fn.vkCmdEndQuery(commands, self.pool, 0)

    def read(self) -> dict[int, int]:
        """Return the counts by bit; the query must have been submitted."""
        bits = [1 << i for i in range(self._flags.bit_length()) if self._flags >> i & 1]
        values = np.zeros(len(bits), np.uint64)
        flags = vk.VK_QUERY_RESULT_64_BIT | vk.VK_QUERY_RESULT_WAIT_BIT
        fn, handle = self._bench.fn, self._bench.device.handle
        code = fn.vkGetQueryPoolResults(
            handle, self.pool, 0, 1, values.nbytes, vk.ffi.from_buffer(values), values.nbytes, flags
        )
        vk.check(code, "vkGetQueryPoolResults")
        return dict(zip(bits, map(int, values), strict=True))
