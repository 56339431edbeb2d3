"""Self-test: a compute shader reads one storage buffer and writes another, in groups that share memory."""

from __future__ import annotations

from backends.selftest import data as data
from backends.vulkan.selftests.bench import Bench


def run(bench: Bench) -> str:
    """Return what was wrong, or ""."""
    return bench.computes(data.compute_buffers())
