"""Self-test: along edges of triangles a texture is read at its mip level, where coordinates come from a buffer.

At an edge a quad of four fragments has some outside the triangle, which only serve derivatives. They must read buffers
as the others do: the llvmpipe of Mesa 22.3 gives them zeros, and takes the coarsest level.
"""

from __future__ import annotations

from backends.selftest import data as data
from backends.vulkan.selftests.bench import Bench


def drawn(bench: Bench, **how: float) -> str:
    """Return what was wrong with the picture through a sampler with `how`, or ""."""
    sources = {"vert": data.EDGES_VERTEX, "frag": data.EDGES_FRAGMENT}
    map_, transform = (
        bench.mipmapped(data.gray_levels(data.EDGES_LEVELS), **how),
        bench.input(data.EDGES_TRANSFORM),
    )
    program = bench.graphics(sources, [map_, transform])
    pixels = bench.render(program, data.SIZE, lambda commands: bench.fn.vkCmdDraw(commands, 6, 1, 0, 0))
    return data.edges_wrong(pixels)


def run(bench: Bench) -> str:
    """Return what was wrong, or ""."""
    return drawn(bench)
