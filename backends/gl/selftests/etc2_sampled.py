"""Self-test: a block of ETC2 is sampled as the texels that its bits stand for."""

from __future__ import annotations

from backends.gl.selftests.bench import Bench
from backends.gl.selftests.block_compression_sampled import sampled
from backends.selftest import data as data


def run(bench: Bench) -> str:
    """Return what was wrong, or ""."""
    return sampled(bench, data.etc2_block())
