"""Self-test: a block of ETC2 is sampled as the texels that its bits stand for."""

from __future__ import annotations

from backends.selftest import data as data
from backends.vulkan.selftests.bench import Bench
from backends.vulkan.selftests.block_compression_sampled import sampled


def run(bench: Bench) -> str:
    """Return what was wrong, or ""."""
    return sampled(bench, data.etc2_block())
