"""Self-test: mesh shaders without a task stage draw one small square each, with their number as colour."""

from __future__ import annotations

from backends.vulkan.selftests import tiles
from backends.vulkan.selftests.bench import Bench, differ


def run(bench: Bench) -> str:
    """Return what was wrong, or ""."""
    program = bench.graphics({"mesh": tiles.MESH, "frag": tiles.FRAGMENT}, extensions=tiles.EXTENSIONS)
    pixels = bench.render(
        program, tiles.SIZE, lambda commands: bench.fn.vkCmdDrawMeshTasksEXT(commands, 8, 2, 1)
    )
    return differ("pixels", pixels, tiles.expected(16))
