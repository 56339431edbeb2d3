"""Self-test: blocks of BC4, BC5 and BC7 are sampled as the texels that their bits stand for."""

from __future__ import annotations

import numpy as np

from backends.gl.selftests.bench import NEAREST, Bench
from backends.selftest import data as data


def sampled(bench: Bench, block: data.Block) -> str:
    """Return what was wrong with the texels of `block`, or ""."""
    texture, output = bench.texture(block.format, (4, 4), [block.data], NEAREST), bench.output(16)
    bench.dispatch(data.BLOCK_COMPUTE, [texture, output])
    return data.differ(f"texels of {block.format}", bench.read(output, np.uint32), block.texels)


def run(bench: Bench) -> str:
    """Return what was wrong, or ""."""
    return next(filter(None, (sampled(bench, block) for block in data.bc_blocks())), "")
