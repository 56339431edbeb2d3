"""Self-test: a triangle drawn as lines colours its edges and not its inside."""

from __future__ import annotations

from backends.selftest import draws as data
from backends.vulkan import api as vk
from backends.vulkan.selftests.bench import Bench


def run(bench: Bench) -> str:
    """Return what was wrong, or ""."""
    sources = {"vert": data.WIREFRAME_VERTEX, "frag": data.ONE_FRAGMENT}
    program = bench.graphics(sources, polygon_mode=vk.VK_POLYGON_MODE_LINE)
    pixels = bench.render(program, data.SIZE, lambda commands: bench.fn.vkCmdDraw(commands, 3, 1, 0, 0))
    return data.wireframe_wrong(pixels)
