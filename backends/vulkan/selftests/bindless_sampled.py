"""Self-test: neighbouring invocations read different textures of one large array, with gaps and written late."""

from __future__ import annotations

import numpy as np

from backends.vulkan.barriers import barriers
from backends.vulkan.selftests import bindings
from backends.vulkan.selftests.bench import EVERYTHING, Bench, differ

COUNT = 40
SLOTS = 512

SOURCE = """
layout(local_size_x = 64) in;
layout(std430, set = 0, binding = 0) readonly buffer A { uint slots[]; };
layout(std430, set = 0, binding = 1) writeonly buffer B { uint b[]; };
layout(set = 0, binding = 2) uniform usampler2D textures[];
void main() {
    uint i = gl_GlobalInvocationID.x;
    b[i] = textureLod(textures[nonuniformEXT(slots[i])], vec2(i % 2u, (i / 2u) % 2u) * 0.5 + 0.25, 0.0).r;
}
"""


def run(bench: Bench) -> str:
    """Return what was wrong, or ""."""
    random = np.random.default_rng(7)
    sampler = bench.sampler()
    texels = np.arange(COUNT * 4, dtype=np.uint32).reshape(COUNT, 2, 2) + 1000
    textures = [bench.texture("r32ui", texel, sampler) for texel in texels]
    filled = random.permutation(SLOTS)[:COUNT]
    which = random.integers(0, COUNT, 1024)
    slots, output = bench.input(filled[which].astype(np.uint32)), bench.output(1024)
    program = bench.compute(SOURCE, [slots, output, [None] * SLOTS], ["GL_EXT_nonuniform_qualifier"])
    with bench.submit() as commands:
        bench.bind(commands, program)
        bench.fn.vkCmdDispatch(commands, 16, 1, 1)
        bench.fn.vkCmdPipelineBarrier2(commands, barriers(memory=EVERYTHING))
        for slot, texture in zip(filled, textures, strict=True):  # after the set was bound
            bindings.write(bench.device, program.set, 2, int(slot), texture)
    i = np.arange(1024)
    expected = texels[which, i // 2 % 2, i % 2]
    return differ("texels", bench.read(output, np.uint32), expected)
