"""Self-test: along edges of triangles a texture is read at its mip level, where coordinates come from a buffer.

Fragments beside the triangle, which only serve derivatives, must read buffers as the others do.
"""

from __future__ import annotations

from backends.gl import api as gl
from backends.gl.selftests.bench import MIPMAPPED, Bench
from backends.selftest import data as data
from common.scene import Sampler


def drawn(bench: Bench, how: Sampler, anisotropy: float = 1.0) -> str:
    """Return what was wrong with the picture through a sampler, or ""."""
    levels = data.gray_levels(data.EDGES_LEVELS)
    map_ = bench.texture("rgba8", data.SIZE, levels, how, anisotropy)
    program = bench.graphics(data.EDGES_VERTEX, data.EDGES_FRAGMENT)
    transform = bench.input(data.EDGES_TRANSFORM)
    pixels = bench.render(program, lambda: bench.fn.glDrawArrays(gl.GL_TRIANGLES, 0, 6), [map_, transform])
    return data.edges_wrong(pixels)


def run(bench: Bench) -> str:
    """Return what was wrong, or ""."""
    return drawn(bench, MIPMAPPED)
