"""Self-test: invocations of compute shaders are counted exactly."""

from __future__ import annotations

import numpy as np

from backends.vulkan import api as vk
from backends.vulkan.barriers import barriers
from backends.vulkan.selftests.bench import EVERYTHING, Bench, differ
from backends.vulkan.selftests.statistics import Statistics

SOURCE = """
layout(local_size_x = 48) in;
layout(std430, set = 0, binding = 0) writeonly buffer B { uint b[]; };
void main() { b[gl_GlobalInvocationID.x] = gl_GlobalInvocationID.x; }
"""


def run(bench: Bench) -> str:
    """Return what was wrong, or ""."""
    bit = vk.VK_QUERY_PIPELINE_STATISTIC_COMPUTE_SHADER_INVOCATIONS_BIT
    output = bench.output(48 * 5)
    program, statistics = bench.compute(SOURCE, [output]), Statistics(bench, bit)
    with bench.submit() as commands:
        bench.bind(commands, program)
        statistics.begin(commands)
        bench.fn.vkCmdDispatch(commands, 5, 1, 1)
        statistics.end(commands)
        bench.fn.vkCmdPipelineBarrier2(commands, barriers(memory=EVERYTHING))
    counted = statistics.read()[bit]
    if counted != 240:
        return f"{counted} invocations were counted and there are 240"
    return differ("numbers", bench.read(output, np.uint32), np.arange(240, dtype=np.uint32))
