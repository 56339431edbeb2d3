"""Self-test: 64-bit integers multiply, divide, shift and compare in a compute shader as they do in Python."""

from __future__ import annotations

from backends.gl.selftests.bench import Bench
from backends.selftest import data as data


def run(bench: Bench) -> str:
    """Return what was wrong, or ""."""
    return bench.computes(data.int64(), ["GL_ARB_gpu_shader_int64"])
