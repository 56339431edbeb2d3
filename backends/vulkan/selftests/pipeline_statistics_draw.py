"""Self-test: vertices, primitives and fragments of a draw are counted exactly."""

from __future__ import annotations

from typing import Any

from backends.vulkan import api as vk
from backends.vulkan.selftests.bench import Bench
from backends.vulkan.selftests.statistics import Statistics

VERTEX = """
void main() {
    vec2 corner = vec2(VERTEX_ID % 3 == 1 ? 3 : -1, VERTEX_ID % 3 == 2 ? 3 : -1);
    gl_Position = vec4(corner, 0.5, 1);
}
"""
FRAGMENT = "layout(location = 0) out uint color; void main() { color = 1u; }"


def run(bench: Bench) -> str:
    """Return what was wrong, or ""."""
    vertices = vk.VK_QUERY_PIPELINE_STATISTIC_INPUT_ASSEMBLY_VERTICES_BIT
    primitives = vk.VK_QUERY_PIPELINE_STATISTIC_INPUT_ASSEMBLY_PRIMITIVES_BIT
    fragments = vk.VK_QUERY_PIPELINE_STATISTIC_FRAGMENT_SHADER_INVOCATIONS_BIT
    program = bench.graphics({"vert": VERTEX, "frag": FRAGMENT})
    statistics = Statistics(bench, vertices | primitives | fragments)

    def record(commands: Any) -> None:
        statistics.begin(commands)
        bench.fn.vkCmdDraw(commands, 6, 1, 0, 0)
        statistics.end(commands)

    pixels = bench.render(program, (16, 16), record)
    if not (pixels == 1).all():
        return "the counted draw did not cover its target"
    counted = statistics.read()
    # Two triangles that cover all 256 pixels each, in order and without a depth test.
    for what, bit, number in (("vertices", vertices, 6), ("primitives", primitives, 2)):
        if counted[bit] != number:
            return f"{counted[bit]} {what} were counted and there are {number}"
    # A driver may leave out fragments that it knows to be hidden, never those that are seen.
    if not 256 <= counted[fragments] <= 512:
        return f"{counted[fragments]} fragments were counted where two triangles cover 256 pixels each"
    return ""
