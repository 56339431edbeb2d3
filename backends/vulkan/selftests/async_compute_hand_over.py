"""Self-test: the compute queue works on a buffer from the graphics queue and gives it back."""

from __future__ import annotations

from typing import Any

from backends.vulkan.resources import Buffer
from backends.vulkan.selftests.bench import Bench
from backends.vulkan.selftests.queues import WORDS, hand_over

SOURCE = """
layout(local_size_x = 64) in;
layout(std430, set = 0, binding = 0) buffer A { uint a[]; };
void main() { a[gl_GlobalInvocationID.x] = a[gl_GlobalInvocationID.x] * 2u + 1u; }
"""


def run(bench: Bench) -> str:
    """Return what was wrong, or ""."""

    def double(commands: Any, shared: Buffer) -> Buffer:
        bench.bind(commands, bench.compute(SOURCE, [shared]))
        bench.fn.vkCmdDispatch(commands, WORDS // 64, 1, 1)
        return shared

    return hand_over(bench, bench.device.compute_queue, double, lambda data: data * 2 + 1)
