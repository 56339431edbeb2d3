"""Self-test: invocations of compute shaders are counted exactly."""

from __future__ import annotations

import numpy as np

from backends.selftest import data as data
from backends.vulkan import api as vk
from backends.vulkan.barriers import barriers
from backends.vulkan.selftests.bench import EVERYTHING, Bench
from backends.vulkan.selftests.statistics import Statistics


def run(bench: Bench) -> str:
    """Return what was wrong, or ""."""
    bit = vk.VK_QUERY_PIPELINE_STATISTIC_COMPUTE_SHADER_INVOCATIONS_BIT
    output = bench.output(data.COUNTED_INVOCATIONS)
    program, statistics = bench.compute(data.COUNTED_COMPUTE, [output]), Statistics(bench, bit)
    with bench.submit() as commands:
        bench.bind(commands, program)
        statistics.begin(commands)
        bench.fn.vkCmdDispatch(commands, data.COUNTED_GROUPS, 1, 1)
        statistics.end(commands)
        bench.fn.vkCmdPipelineBarrier2(commands, barriers(memory=EVERYTHING))
    return data.computed_count(statistics.read()[bit], bench.read(output, np.uint32))
