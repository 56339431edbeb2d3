"""Self-test: a sampler with the minimum or maximum filter returns that of its four texels, not their mean."""

from __future__ import annotations

import numpy as np

from backends.selftest import data as data
from backends.vulkan import api as vk
from backends.vulkan.selftests.bench import Bench


def run(bench: Bench) -> str:
    """Return what was wrong, or ""."""
    texels, expected = data.minmax()
    textures = []
    for mode in (vk.VK_SAMPLER_REDUCTION_MODE_MIN, vk.VK_SAMPLER_REDUCTION_MODE_MAX):
        reduction = vk.new("VkSamplerReductionModeCreateInfo", reductionMode=mode)
        linear = vk.VK_FILTER_LINEAR
        sampler = bench.sampler(pNext=reduction, magFilter=linear, minFilter=linear)
        textures.append(bench.texture("r32f", texels, sampler))
    output = bench.output(expected.size)
    bench.dispatch(data.MINMAX_COMPUTE, [*textures, output])
    return data.differ("texels", bench.read(output, np.float32), expected)
