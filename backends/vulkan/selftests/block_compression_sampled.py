"""Self-test: blocks of BC4, BC5 and BC7 are sampled as the texels that their bits stand for."""

from __future__ import annotations

import numpy as np

from backends.vulkan import api as vk
from backends.vulkan.selftests import bindings
from backends.vulkan.selftests.bench import Bench, differ

SOURCE = """
layout(local_size_x = 16) in;
layout(set = 0, binding = 0) uniform sampler2D blocks;
layout(std430, set = 0, binding = 1) writeonly buffer B { uint b[]; };
void main() {
    uint i = gl_LocalInvocationID.x;
    b[i] = packUnorm4x8(texelFetch(blocks, ivec2(i % 4u, i / 4u), 0));
}
"""
"""Writes the texels of one block; `etc2_sampled` runs it too."""


def packed(*fields: tuple[int, int]) -> np.ndarray:
    """Return a block's bytes of (value, bits) fields, the lowest bits first, in memory's order."""
    value = place = 0
    for field, width in fields:
        value |= field << place
        place += width
    return np.frombuffer(value.to_bytes(place // 8, "little"), np.uint8)


def words(red: np.ndarray, green: np.ndarray, blue: np.ndarray, alpha: np.ndarray) -> np.ndarray:
    """Return texels (16,) as the shader packs them."""
    return (red | green << 8 | blue << 16 | alpha << 24).astype(np.uint32)


def sampled(bench: Bench, format: str, block: np.ndarray, expected: np.ndarray) -> str:
    """Return what was wrong with the texels of `block`, or ""."""
    image = bench.image(format, (4, 4), vk.VK_IMAGE_USAGE_SAMPLED_BIT)
    bench.fill(image.handle, (4, 4), block)
    texture = bindings.Texture(image.view, bench.sampler())
    output = bench.output(16)
    bench.dispatch(SOURCE, [texture, output])
    return differ(f"texels of {format}", bench.read(output, np.uint32), expected)


def run(bench: Bench) -> str:
    """Return what was wrong, or ""."""
    random = np.random.default_rng(6)
    zero, full = np.zeros(16, np.uint32), np.full(16, 255, np.uint32)
    # One channel in 8 bytes: two ends, the lower one first, and 3 bits a texel, of which 6 is black and 7 white.
    ends = np.array([40, 200, 0, 0, 0, 0, 0, 255], np.uint32)
    red, green = random.choice([0, 1, 6, 7], (2, 16))
    one, two = (packed((40, 8), (200, 8), *((int(code), 3) for code in codes)) for codes in (red, green))
    # BC7's mode 6: ends of 7 bits a channel and one more that its channels share, and 4 bits a texel (the first: 3).
    low, high = (10, 20, 30, 40), (120, 90, 70, 127)
    colors = [(end[channel], 7) for channel in range(4) for end in (low, high)]
    last = random.choice([0, 15], 16)
    last[0] = 0
    indices = [(int(code), 3 if texel == 0 else 4) for texel, code in enumerate(last)]
    seven = packed((1 << 6, 7), *colors, (0, 1), (1, 1), *indices)
    texels = [np.where(last == 0, 2 * low[c], 2 * high[c] + 1).astype(np.uint32) for c in range(4)]
    return (
        sampled(bench, "bc4", one, words(ends[red], zero, zero, full))
        or sampled(bench, "bc5", np.concatenate([one, two]), words(ends[red], ends[green], zero, full))
        or sampled(bench, "bc7", seven, words(*texels))
    )
