"""Self-test: 64-bit integers multiply, divide, shift and compare in a compute shader as they do in Python."""

from __future__ import annotations

from backends.selftest import data as data
from backends.vulkan.selftests.bench import Bench


def run(bench: Bench) -> str:
    """Return what was wrong, or ""."""
    return bench.computes(data.int64(), ["GL_EXT_shader_explicit_arithmetic_types_int64"])
