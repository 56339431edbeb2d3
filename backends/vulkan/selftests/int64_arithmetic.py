"""Self-test: 64-bit integers multiply, divide, shift and compare in a compute shader as they do in Python."""

from __future__ import annotations

import numpy as np

from backends.vulkan.selftests.bench import Bench, differ

SOURCE = """
layout(local_size_x = 64) in;
layout(std430, set = 0, binding = 0) readonly buffer A { uint64_t a[]; };
layout(std430, set = 0, binding = 1) writeonly buffer B { uint64_t b[]; };
void main() {
    uint i = gl_GlobalInvocationID.x;
    uint64_t x = a[i], y = a[i ^ 1u];
    b[4 * i + 0] = x * y + 12345678901234567ul;
    b[4 * i + 1] = x / (y | 1ul);
    b[4 * i + 2] = (x >> 7) ^ (y << 33);
    b[4 * i + 3] = x > y ? x - y : uint64_t(int64_t(x) >> 3);
}
"""


def run(bench: Bench) -> str:
    """Return what was wrong, or ""."""
    x = np.random.default_rng(64).integers(0, 2**64, 64, dtype=np.uint64)
    y = x[np.arange(64) ^ 1]
    with np.errstate(over="ignore"):
        expected = np.stack(
            [
                x * y + np.uint64(12345678901234567),
                x // (y | np.uint64(1)),
                (x >> np.uint64(7)) ^ (y << np.uint64(33)),
                np.where(x > y, x - y, (x.view(np.int64) >> np.int64(3)).view(np.uint64)),
            ],
            axis=1,
        )
    output = bench.output(2 * expected.size)
    extensions = ["GL_EXT_shader_explicit_arithmetic_types_int64"]
    bench.dispatch(SOURCE, [bench.input(x), output], extensions=extensions)
    return differ("numbers", bench.read(output, np.uint64), expected.ravel())
