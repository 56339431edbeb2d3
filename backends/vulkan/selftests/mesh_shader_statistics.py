"""Self-test: primitives and fragments are counted around a mesh draw, and the picture is right."""

from __future__ import annotations

from typing import Any

from backends.vulkan import api as vk
from backends.vulkan.selftests import tiles
from backends.vulkan.selftests.bench import Bench, differ
from backends.vulkan.selftests.statistics import Statistics

FRAGMENTS = vk.VK_QUERY_PIPELINE_STATISTIC_FRAGMENT_SHADER_INVOCATIONS_BIT
COMPUTE = vk.VK_QUERY_PIPELINE_STATISTIC_COMPUTE_SHADER_INVOCATIONS_BIT
PRIMITIVES = vk.VK_QUERY_PIPELINE_STATISTIC_CLIPPING_PRIMITIVES_BIT


def run(bench: Bench) -> str:
    """Return what was wrong, or ""."""
    program = bench.graphics({"mesh": tiles.MESH, "frag": tiles.FRAGMENT}, extensions=tiles.EXTENSIONS)
    statistics = Statistics(bench, FRAGMENTS | PRIMITIVES | COMPUTE)

    def record(commands: Any) -> None:
        statistics.begin(commands)
        bench.fn.vkCmdDrawMeshTasksEXT(commands, 8, 2, 1)
        statistics.end(commands)

    pixels = bench.render(program, tiles.SIZE, record)
    wrong = differ("pixels", pixels, tiles.expected(16))
    counted = statistics.read()
    if wrong:
        return wrong
    if counted[PRIMITIVES] != 32:
        return f"{counted[PRIMITIVES]} primitives were counted and there are 32"
    # Helper invocations at the edges may be counted too: two triangles of 4x4 pixels run in 2x2 blocks.
    if not 256 <= counted[FRAGMENTS] <= 2 * 256:
        return f"{counted[FRAGMENTS]} fragments were counted where 256 pixels are covered"
    if counted[COMPUTE]:  # mesh shaders are none
        return f"{counted[COMPUTE]} compute invocations were counted and there are none"
    return ""
