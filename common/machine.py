"""What the machine has left."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path

MEMINFO = Path("/proc/meminfo")
LIMIT = Path("/sys/fs/cgroup/memory.max")
"""What a container may have of the machine's memory, in bytes, or "max"."""


def free_memory() -> int | None:
    """Return how many bytes a program can still have without being ended for it; None where the system says nothing.

    Linux gives memory that is not there, and ends the program that writes to it: a program has to ask before.
    """
    limits = []
    with suppress(OSError, ValueError, IndexError):
        for line in MEMINFO.read_text("ascii").splitlines():
            if line.startswith("MemAvailable:"):
                limits.append(int(line.split()[1]) << 10)
    with suppress(OSError, ValueError):
        limits.append(int(LIMIT.read_text("ascii")))
    return min(limits, default=None)
