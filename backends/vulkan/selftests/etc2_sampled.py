"""Self-test: a block of ETC2 is sampled as the texels that its bits stand for."""

from __future__ import annotations

import numpy as np

from backends.vulkan.selftests.bench import Bench
from backends.vulkan.selftests.block_compression_sampled import sampled, words

BASE = (5, 17, 28)
MODIFIERS = np.array([2, 8, -2, -8])
"""Of table 0, by a texel's code."""


def run(bench: Bench) -> str:
    """Return what was wrong, or ""."""
    codes = np.random.default_rng(7).integers(0, 4, (4, 4))  # by row and column
    # Differential: two halves of the same colour, 5 bits a channel and a difference of 0. Texels are numbered by
    # columns, and the upper bits of their codes come before the lower ones, texel 15 first.
    red, green, blue = BASE
    value = red << 59 | green << 51 | blue << 43 | 1 << 33
    for texel, code in enumerate(codes.T.ravel().tolist()):
        value |= (code >> 1) << (16 + texel) | (code & 1) << texel
    block = np.frombuffer(value.to_bytes(8, "big"), np.uint8)
    texels = [(channel << 3 | channel >> 2) + MODIFIERS[codes.ravel()] for channel in BASE]
    red_, green_, blue_ = (np.clip(channel, 0, 255).astype(np.uint32) for channel in texels)
    return sampled(bench, "etc2", block, words(red_, green_, blue_, np.full(16, 255, np.uint32)))
