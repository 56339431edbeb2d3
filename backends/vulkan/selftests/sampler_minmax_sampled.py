"""Self-test: a sampler with the minimum or maximum filter returns that of its four texels, not their mean."""

from __future__ import annotations

import numpy as np

from backends.vulkan import api as vk
from backends.vulkan.selftests.bench import Bench, differ

SOURCE = """
layout(local_size_x = 64) in;
layout(set = 0, binding = 0) uniform sampler2D smallest;
layout(set = 0, binding = 1) uniform sampler2D largest;
layout(std430, set = 0, binding = 2) writeonly buffer B { vec2 b[]; };
void main() {
    uint i = gl_GlobalInvocationID.x;
    vec2 uv = (vec2(i % 8u, i / 8u) * 2.0 + 1.0) / 16.0;
    b[i] = vec2(textureLod(smallest, uv, 0.0).r, textureLod(largest, uv, 0.0).r);
}
"""


def run(bench: Bench) -> str:
    """Return what was wrong, or ""."""
    data = np.random.default_rng(4).permutation(256).reshape(16, 16).astype(np.float32)
    textures = []
    for mode in (vk.VK_SAMPLER_REDUCTION_MODE_MIN, vk.VK_SAMPLER_REDUCTION_MODE_MAX):
        reduction = vk.new("VkSamplerReductionModeCreateInfo", reductionMode=mode)
        linear = vk.VK_FILTER_LINEAR
        sampler = bench.sampler(pNext=reduction, magFilter=linear, minFilter=linear)
        textures.append(bench.texture("r32f", data, sampler))
    output = bench.output(128)
    bench.dispatch(SOURCE, [*textures, output])
    blocks = data.reshape(8, 2, 8, 2)
    expected = np.stack([blocks.min((1, 3)), blocks.max((1, 3))], axis=-1)
    return differ("texels", bench.read(output, np.float32), expected.ravel())
