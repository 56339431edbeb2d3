"""Self-test: the GPU's own number of draws, below the length of the list; each with its number and instance offset."""

from __future__ import annotations

from backends.selftest import draws as data
from backends.vulkan.selftests.bench import Bench


def run(bench: Bench) -> str:
    """Return what was wrong, or ""."""
    vertex = data.SQUARES_VERTEX.replace("DRAW", "gl_DrawID")
    program = bench.graphics({"vert": vertex, "frag": data.NUMBER_FRAGMENT})
    draws, count = bench.input(data.COUNTED_DRAWS), bench.input(data.COUNT)
    pixels = bench.render(
        program,
        data.SIZE,
        lambda commands: bench.fn.vkCmdDrawIndirectCount(commands, draws.handle, 0, count.handle, 0, 4, 16),
    )
    return data.counted_draws_wrong(pixels)
