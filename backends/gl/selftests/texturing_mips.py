"""Self-test: a shader reads each mip level of a texture, and the mean of two levels halfway between them."""

from __future__ import annotations

from backends.gl import api as gl
from backends.gl.selftests.bench import MIPMAPPED, Bench
from backends.selftest import data as data


def run(bench: Bench) -> str:
    """Return what was wrong, or ""."""
    map_ = bench.texture("rgba8", data.SIZE, data.gray_levels(data.MIPS_LEVELS), MIPMAPPED)
    program = bench.graphics(data.FULL_SCREEN, data.MIPS_FRAGMENT)
    pixels = bench.render(program, lambda: bench.fn.glDrawArrays(gl.GL_TRIANGLES, 0, 3), [map_])
    return data.mips_wrong(pixels)
