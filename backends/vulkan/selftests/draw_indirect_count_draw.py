"""Self-test: the GPU's own number of draws, below the length of the list; each with its number and instance offset."""

from __future__ import annotations

import numpy as np

from backends.vulkan.selftests import tiles
from backends.vulkan.selftests.bench import Bench, differ

VERTEX = """
layout(location = 0) flat out uint number;
void main() {
    uint tile = uint(INSTANCE_ID);
    number = uint(gl_DrawID) * 100u + tile + 1u;
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
    # Vertices, instances, first vertex, first instance: squares 0-2, none, 8-9, and one beyond the count.
    list_ = np.array([(6, 3, 0, 0), (6, 0, 0, 4), (6, 2, 6, 8), (6, 9, 0, 20)], np.uint32)
    draws, count = bench.input(list_), bench.input(np.array([3], np.uint32))
    pixels = bench.render(
        program,
        tiles.SIZE,
        lambda commands: bench.fn.vkCmdDrawIndirectCount(commands, draws.handle, 0, count.handle, 0, 4, 16),
    )
    every = tiles.expected(10).astype(np.int64)
    expected = np.where(every <= 3, every, np.where(every >= 9, every + 200, 0))
    return differ("pixels", pixels, expected.astype(np.uint32))
