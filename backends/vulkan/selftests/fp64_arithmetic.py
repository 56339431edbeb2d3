"""Self-test: 64-bit floats add, multiply, divide and take roots to the precision that Vulkan asks for."""

from __future__ import annotations

import numpy as np

from backends.vulkan.selftests.bench import Bench

SOURCE = """
layout(local_size_x = 64) in;
layout(std430, set = 0, binding = 0) readonly buffer A { double a[]; };
layout(std430, set = 0, binding = 1) writeonly buffer B { double b[]; };
void main() {
    uint i = gl_GlobalInvocationID.x;
    double x = a[i], y = a[i ^ 1u];
    b[4 * i + 0] = x + y * 1e-9lf;
    b[4 * i + 1] = x * y;
    b[4 * i + 2] = x / y;
    b[4 * i + 3] = sqrt(abs(x));
}
"""


def run(bench: Bench) -> str:
    """Return what was wrong, or ""."""
    x = np.random.default_rng(53).uniform(1.0, 2.0, 64) * np.where(np.arange(64) % 3, 1.0, -1e6)
    y = x[np.arange(64) ^ 1]
    expected = np.stack([x + y * 1e-9, x * y, x / y, np.sqrt(np.abs(x))], axis=1).ravel()
    output = bench.output(2 * expected.size)
    bench.dispatch(SOURCE, [bench.input(x), output])
    found = bench.read(output, np.float64)
    # Division and root may be off by some steps of the last place; 32-bit floats would be off by 1e-8 and more.
    error = np.max(np.abs(found - expected) / np.abs(expected))
    return "" if error < 1e-14 else f"the relative error is {error:.1e}"
