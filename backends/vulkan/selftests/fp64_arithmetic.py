"""Self-test: 64-bit floats add, multiply, divide and take roots to the precision that both APIs ask for."""

from __future__ import annotations

from backends.selftest import data as data
from backends.vulkan.selftests.bench import Bench


def run(bench: Bench) -> str:
    """Return what was wrong, or ""."""
    return bench.computes(data.fp64())
