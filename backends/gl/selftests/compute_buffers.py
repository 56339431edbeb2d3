"""Self-test: a compute shader reads one storage buffer and writes another, in groups that share memory."""

from __future__ import annotations

from backends.gl.selftests.bench import Bench
from backends.selftest import data as data


def run(bench: Bench) -> str:
    """Return what was wrong, or ""."""
    return bench.computes(data.compute_buffers())
