"""Self-test: 64-bit integers multiply, divide, shift and compare in a compute shader as they do in Python."""

from __future__ import annotations

from backends import selftest_data as data
from backends.gl.selftests.bench import Bench


def run(bench: Bench) -> str:
    """Return what was wrong, or ""."""
    return bench.computes(data.int64(), ["GL_ARB_gpu_shader_int64"])
