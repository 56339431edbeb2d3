"""What the machine has left."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

MEMINFO = Path("/proc/meminfo")
OWN_GROUPS, GROUPS = Path("/proc/self/cgroup"), Path("/sys/fs/cgroup")
"""Of which control groups this process is, and where their files are: containers and batch systems limit memory so."""


def free_memory() -> int | None:
    """Return how many bytes a program can still have without being ended for it; None where the system says nothing.

    Linux gives memory that is not there, and ends the program that writes to it: a program has to ask before.
    """
    left = [*_left_in_groups()]
    with suppress(OSError, ValueError, IndexError):
        for line in MEMINFO.read_text("ascii").splitlines():
            if line.startswith("MemAvailable:"):
                left.append(int(line.split()[1]) << 10)
    return min(left, default=None)


def _left_in_groups() -> Iterator[int]:
    """Yield what each limit of the process's groups leaves; a group has the limits of all groups around it, too.

    Lines of OWN_GROUPS are "number:controllers:/path": of version 2 "0::/path", of version 1 "9:memory:/path".
    """
    lines = []
    with suppress(OSError, ValueError):
        lines = OWN_GROUPS.read_text("utf-8").splitlines()
    for line in lines:
        _, controllers, place = [*line.split(":", 2), "", ""][:3]
        if not controllers:
            mount, limit, used, idle = GROUPS, "memory.max", "memory.current", "inactive_file"
        elif "memory" in controllers.split(","):
            mount, limit, used = GROUPS / "memory", "memory.limit_in_bytes", "memory.usage_in_bytes"
            idle = "total_inactive_file"
        else:
            continue
        own = Path(place.lstrip("/"))
        for group in (own, *own.parents):
            # A limit that is no number is "max": none. Copies of files that are not in use go when memory is needed.
            with suppress(OSError, ValueError):
                most, taken = (int((mount / group / name).read_text("ascii")) for name in (limit, used))
                yield max(most - max(taken - _told(mount / group / "memory.stat", idle), 0), 0)


def _told(file: Path, name: str) -> int:
    """Return the number of a name in a file of lines "name number"; 0 where it is not there."""
    with suppress(OSError, ValueError):
        words = file.read_text("ascii").split()
        return int(dict(zip(words[::2], words[1::2], strict=False)).get(name, 0))
    return 0
