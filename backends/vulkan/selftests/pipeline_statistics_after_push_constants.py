"""Self-test: counting of compute invocations begins after push constants for all stages, with nothing to compute."""

from __future__ import annotations

from typing import Any

import numpy as np

from backends.vulkan import api as vk
from backends.vulkan.selftests.bench import FULL_SCREEN, Bench, differ
from backends.vulkan.selftests.statistics import Statistics

FRAGMENT = """
PUSH(uvec4, pushed)
layout(location = 0) out uint color;
void main() { color = pushed.x; }
"""


def run(bench: Bench) -> str:
    """Return what was wrong, or ""."""
    bit = vk.VK_QUERY_PIPELINE_STATISTIC_COMPUTE_SHADER_INVOCATIONS_BIT
    program = bench.graphics({"vert": FULL_SCREEN, "frag": FRAGMENT}, push=16)
    statistics = Statistics(bench, bit)
    values = vk.array("uint32_t", [77, 0, 0, 0])

    def record(commands: Any) -> None:
        bench.fn.vkCmdPushConstants(commands, program.layout, vk.VK_SHADER_STAGE_ALL, 0, 16, values)
        statistics.begin(commands)
        bench.fn.vkCmdDraw(commands, 3, 1, 0, 0)
        statistics.end(commands)

    pixels = bench.render(program, (8, 8), record)
    counted = statistics.read()[bit]
    if counted:
        return f"{counted} compute invocations were counted and there are none"
    return differ("pixels", pixels, np.full((8, 8), 77, np.uint32))
