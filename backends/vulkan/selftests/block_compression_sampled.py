"""Self-test: blocks of BC4, BC5 and BC7 are sampled as the texels that their bits stand for."""

from __future__ import annotations

import numpy as np

from backends.selftest import data as data
from backends.vulkan import api as vk
from backends.vulkan.selftests import bindings
from backends.vulkan.selftests.bench import Bench


def sampled(bench: Bench, block: data.Block) -> str:
    """Return what was wrong with the texels of `block`, or ""."""
    image = bench.image(block.format, (4, 4), vk.VK_IMAGE_USAGE_SAMPLED_BIT)
    bench.fill(image.handle, (4, 4), block.data)
    output = bench.output(16)
    bench.dispatch(data.BLOCK_COMPUTE, [bindings.Texture(image.view, bench.sampler()), output])
    return data.differ(f"texels of {block.format}", bench.read(output, np.uint32), block.texels)


def run(bench: Bench) -> str:
    """Return what was wrong, or ""."""
    return next(filter(None, (sampled(bench, block) for block in data.bc_blocks())), "")
