"""Self-test: a shader reads each mip level of a texture, and the mean of two levels halfway between them."""

from __future__ import annotations

from backends.selftest import data as data
from backends.vulkan.selftests.bench import Bench


def run(bench: Bench) -> str:
    """Return what was wrong, or ""."""
    sources = {"vert": data.FULL_SCREEN, "frag": data.MIPS_FRAGMENT}
    program = bench.graphics(sources, [bench.mipmapped(data.gray_levels(data.MIPS_LEVELS))])
    pixels = bench.render(program, data.SIZE, lambda commands: bench.fn.vkCmdDraw(commands, 3, 1, 0, 0))
    return data.mips_wrong(pixels)
