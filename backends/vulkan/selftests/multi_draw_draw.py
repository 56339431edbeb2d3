"""Self-test: one call makes every draw of a list, each with its own indices and from its own first instance on."""

from __future__ import annotations

from backends.selftest import draws as data
from backends.vulkan.selftests.bench import Bench


def run(bench: Bench) -> str:
    """Return what was wrong, or ""."""
    vertex = data.SQUARES_VERTEX.replace("DRAW", "0")
    program = bench.graphics({"vert": vertex, "frag": data.NUMBER_FRAGMENT})
    draws = bench.input(data.MULTI_DRAWS)
    pixels = bench.render(
        program, data.SIZE, lambda commands: bench.fn.vkCmdDrawIndirect(commands, draws.handle, 0, 4, 16)
    )
    return data.multi_draws_wrong(pixels)
