"""Self-test: a sampler with the minimum or maximum filter returns that of its four texels, not their mean."""

from __future__ import annotations

import numpy as np

from backends.gl import api as gl
from backends.gl.selftests.bench import Bench
from backends.selftest import data as data
from common.scene import Sampler

LINEAR = Sampler("linear", "linear", None, "clamp", "clamp")


def run(bench: Bench) -> str:
    """Return what was wrong, or ""."""
    texels, expected = data.minmax()
    textures = []
    for mode in (gl.GL_MIN, gl.GL_MAX):
        texture = bench.texture("r32f", data.SIZE, [texels], LINEAR)
        bench.fn.glSamplerParameteri(texture.sampler, gl.GL_TEXTURE_REDUCTION_MODE_ARB, mode)
        textures.append(texture)
    output = bench.output(expected.size)
    bench.dispatch(data.MINMAX_COMPUTE, [*textures, output])
    return data.differ("texels", bench.read(output, np.float32), expected)
