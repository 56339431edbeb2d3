"""Self-test: the transfer queue copies a buffer from the graphics queue and gives the copy back."""

from __future__ import annotations

from typing import Any

from backends.vulkan.resources import Buffer, create_buffer, destroy_buffer
from backends.vulkan.selftests.bench import BUFFER_USAGE, Bench
from backends.vulkan.selftests.queues import WORDS, copy, hand_over


def run(bench: Bench) -> str:
    """Return what was wrong, or ""."""
    target = create_buffer(bench.device, 4 * WORDS, BUFFER_USAGE, "device", "copied")
    bench.at_end(destroy_buffer, bench.device, target)

    def record(commands: Any, shared: Buffer) -> Buffer:
        copy(bench, commands, shared, target)
        return target

    return hand_over(bench, bench.device.transfer_queue, record, lambda data: data)
