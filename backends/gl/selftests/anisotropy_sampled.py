"""Self-test: with an elongated footprint, an anisotropic sampler takes a finer mip level than a trilinear one.

It also ends in time where a footprint is odd: see `too_slow`.
"""

from __future__ import annotations

from functools import partial

import numpy as np

from backends.gl import api as gl
from backends.gl.selftests import texturing_edges
from backends.gl.selftests.bench import Bench
from backends.selftest.data import ANISOTROPY, FULL_SCREEN, too_slow
from common.scene import Sampler

TRILINEAR = Sampler("linear", "linear", "linear", "clamp", "clamp")

# Each level holds its own number; from pixel to pixel it is 16 texels across, and 1 down.
FRAGMENT = """
layout(BIND(0, 0, 0)) uniform sampler2D trilinear;
layout(BIND(0, 1, 1)) uniform sampler2D anisotropic;
layout(location = 0) out uint color;
void main() {
    vec2 uv = gl_FragCoord.xy * vec2(16.0, 1.0) / 256.0;
    color = packUnorm2x16(vec2(texture(trilinear, uv).r, texture(anisotropic, uv).r));
}
"""


def run(bench: Bench) -> str:
    """Return what was wrong, or ""."""
    return (
        _levels(bench)
        or texturing_edges.drawn(bench, TRILINEAR, ANISOTROPY)
        or too_slow(partial(texturing_edges.drawn, bench, TRILINEAR))
    )


def _levels(bench: Bench) -> str:
    levels = [np.full((256 >> n, 256 >> n), 20 * n, np.uint8) for n in range(9)]
    textures = [bench.texture("r8", (256, 256), levels, TRILINEAR, ratio) for ratio in (1.0, ANISOTROPY)]
    program = bench.graphics(FULL_SCREEN, FRAGMENT)
    pixels = bench.render(program, lambda: bench.fn.glDrawArrays(gl.GL_TRIANGLES, 0, 3), textures)
    plain, better = (half / 65535.0 * 255.0 / 20.0 for half in (pixels & 0xFFFF, pixels >> 16))
    # log2(16) = 4 without; with a ratio of N, log2(16 / N), for which drivers take some freedom.
    wanted = max(4.0 - np.log2(bench.ratio(ANISOTROPY)), 0.0)
    for name, samples, level, freedom in (
        ("trilinear", plain, 4.0, 0.25),
        ("anisotropic", better, wanted, 1.0),
    ):
        worst = samples.ravel()[np.abs(samples - level).argmax()]
        if abs(worst - level) > freedom:
            return f"the {name} sampler took level {worst:.2f} and should take {level:.0f}"
    return ""
