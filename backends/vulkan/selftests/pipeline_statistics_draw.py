"""Self-test: vertices, primitives and fragments of a draw are counted exactly."""

from __future__ import annotations

from typing import Any

from backends.selftest import draws as data
from backends.vulkan import api as vk
from backends.vulkan.selftests.bench import Bench
from backends.vulkan.selftests.statistics import Statistics


def run(bench: Bench) -> str:
    """Return what was wrong, or ""."""
    bits = (
        vk.VK_QUERY_PIPELINE_STATISTIC_INPUT_ASSEMBLY_VERTICES_BIT,
        vk.VK_QUERY_PIPELINE_STATISTIC_INPUT_ASSEMBLY_PRIMITIVES_BIT,
        vk.VK_QUERY_PIPELINE_STATISTIC_FRAGMENT_SHADER_INVOCATIONS_BIT,
    )
    program = bench.graphics({"vert": data.TWICE_VERTEX, "frag": data.ONE_FRAGMENT})
    statistics = Statistics(bench, sum(bits))

    def record(commands: Any) -> None:
        statistics.begin(commands)
        bench.fn.vkCmdDraw(commands, 6, 1, 0, 0)
        statistics.end(commands)

    pixels = bench.render(program, data.SIZE, record)
    counted = statistics.read()
    return data.drawn_counts_wrong(pixels, *(counted[bit] for bit in bits))
