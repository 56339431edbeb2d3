"""Self-test: one call makes every draw of a list, each with its own indices and from its own first instance on."""

from __future__ import annotations

import numpy as np

from backends.vulkan.selftests import tiles
from backends.vulkan.selftests.bench import Bench, differ

VERTEX = """
layout(location = 0) flat out uint number;
void main() {
    uint tile = uint(INSTANCE_ID);
    number = tile + 1u;
    uint corner = uint[](0, 1, 2, 2, 1, 3)[VERTEX_ID % 6];
    vec2 at = vec2(tile % 8u, tile / 8u) + vec2(corner & 1u, corner >> 1u);
    gl_Position = vec4(at / 4.0 - 1.0, 0.5, 1.0);
}
"""
FRAGMENT = """
layout(location = 0) flat in uint number;
layout(location = 0) out uint color;
void main() { color = number; }
"""


def run(bench: Bench) -> str:
    """Return what was wrong, or ""."""
    program = bench.graphics({"vert": VERTEX, "frag": FRAGMENT})
    # Vertices, instances, first vertex, first instance: squares 0-2, none, 8-9 and 63.
    list_ = np.array([(6, 3, 0, 0), (6, 0, 0, 4), (6, 2, 6, 8), (6, 1, 0, 63)], np.uint32)
    draws = bench.input(list_)
    pixels = bench.render(
        program, tiles.SIZE, lambda commands: bench.fn.vkCmdDrawIndirect(commands, draws.handle, 0, 4, 16)
    )
    every = tiles.expected(64).astype(np.int64)
    drawn = (every <= 3) | (every == 9) | (every == 10) | (every == 64)
    return differ("pixels", pixels, np.where(drawn, every, 0).astype(np.uint32))
