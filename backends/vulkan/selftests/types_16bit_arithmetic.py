"""Self-test: 16-bit integers wrap around, half floats round to nearest, and both lie in buffers at 2 bytes."""

from __future__ import annotations

import numpy as np

from backends.vulkan.selftests.bench import Bench, differ

EXTENSIONS = ("GL_EXT_shader_explicit_arithmetic_types", "GL_EXT_shader_16bit_storage")

SOURCE = """
layout(local_size_x = 64) in;
layout(std430, set = 0, binding = 0) readonly buffer A { int16_t a[]; };
layout(std430, set = 0, binding = 1) readonly buffer B { float16_t b[]; };
layout(std430, set = 0, binding = 2) writeonly buffer C { int16_t c[]; };
layout(std430, set = 0, binding = 3) writeonly buffer D { float16_t d[]; };
void main() {
    uint i = gl_GlobalInvocationID.x;
    c[i] = a[i] * int16_t(3) + a[i ^ 1u];
    d[i] = b[i] * b[i ^ 1u];
}
"""


def run(bench: Bench) -> str:
    """Return what was wrong, or ""."""
    random = np.random.default_rng(16)
    a = random.integers(-(2**15), 2**15, 64).astype(np.int16)
    b = random.uniform(-30.0, 30.0, 64).astype(np.float16)
    other = np.arange(64) ^ 1
    integers, halves = bench.output(32), bench.output(32)
    bench.dispatch(SOURCE, [bench.input(a), bench.input(b), integers, halves], extensions=EXTENSIONS)
    expected = (a.astype(np.int64) * 3 + a[other]).astype(np.int16)
    wrong = differ("16-bit integers", bench.read(integers, np.int16), expected)
    # Vulkan lets a product of halves round up or down; the exact one is known in 32 bits.
    exact = b.astype(np.float32) * b[other].astype(np.float32)
    results = bench.read(halves, np.float16)
    step = np.spacing(np.abs(exact).astype(np.float16)).astype(np.float32)
    if not wrong and not (np.abs(results.astype(np.float32) - exact) <= step).all():
        wrong = "products of half floats are off by more than the last place"
    return wrong
