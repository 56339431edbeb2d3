"""Keeps the folders of the cache from growing for ever: what was not read for longest goes first."""

from __future__ import annotations

import contextlib
import os
import time
from pathlib import Path

DAY_S = 86_400.0


def mark_read(path: Path) -> None:
    """Note that an entry was used, at most once a day: its time of change is when it was last needed."""
    with contextlib.suppress(OSError):
        if time.time() - path.stat().st_mtime > DAY_S:
            os.utime(path)


def prune(folder: Path, most_bytes: int) -> int:
    """Remove the entries that were needed longest ago until at most `most_bytes` are left; return how many went.

    Entries of the last day stay: other processes may be about to read them. Entries that cannot be removed stay too.
    A file that begins with a dot is being written. It is removed a day after its last write: its program was killed.
    """
    entries, removed = [], 0
    newest = time.time() - DAY_S
    with contextlib.suppress(OSError):
        for entry in os.scandir(folder):
            with contextlib.suppress(OSError):
                if entry.is_file(follow_symlinks=False):
                    state = entry.stat(follow_symlinks=False)
                    if entry.name.startswith("."):
                        if state.st_mtime <= newest:
                            os.unlink(entry.path)
                            removed += 1
                        continue
                    entries.append((state.st_mtime, state.st_size, entry.path))
    total = sum(size for _, size, _ in entries)
    for when, size, path in sorted(entries):
        if total <= most_bytes or when > newest:
            break
        with contextlib.suppress(OSError):
            os.unlink(path)
            total -= size
            removed += 1
    return removed
