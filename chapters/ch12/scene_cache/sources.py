"""The source files of a scene, and whether they have changed since its cache was written.

Contents decide: a cache is valid as long as the bytes of every file are the same. Reading 500 MB to check that would
take much of the time that the cache saves, so the state in the file system is compared first: size, modification time,
change time and inode. If all are equal, the file was not written. A program cannot set the change time, so tools that
restore the modification time (rsync, tar, touch) are noticed. Clocks of file systems are coarse: a file that was
written less than two seconds before it was hashed may have changed again unnoticed, so its contents are hashed every
time.
"""

from __future__ import annotations

import hashlib
import os
import stat
import time
from collections.abc import Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any, NamedTuple

from common.files.regular_files import leads_outside, open_regular

RACY_NS = 2_000_000_000
"""Two seconds: the coarsest clock of a file system in use (FAT)."""

ABSENT = (-1, 0, 0, 0)


class State(NamedTuple):
    """What the file system says of a file; `ABSENT` where there is none."""

    size: int
    changed_ns: int
    entry_changed_ns: int
    number: int


def state_of(path: Path, folder: Path | None = None) -> State:
    """Return the state of a file; what cannot be asked for, or is no regular file, is absent.

    With `folder`, what a link leads to outside that folder is absent as well, as it is when a scene is loaded.
    """
    try:
        status = path.stat()
    except (OSError, ValueError):
        return State(*ABSENT)
    if not stat.S_ISREG(status.st_mode) or (folder is not None and leads_outside(path, folder)):
        return State(*ABSENT)
    return State(status.st_size, status.st_mtime_ns, status.st_ctime_ns, status.st_ino)


def digest(path: Path) -> str:
    """Return a hash of a file's bytes, "" where there is none."""
    try:
        with open_regular(path) as stream:
            return hashlib.file_digest(
                stream, "sha256"
            ).hexdigest()  # half again as fast as BLAKE2 on recent processors
    except (FileNotFoundError, ValueError):
        return ""


def digests(paths: Iterable[Path]) -> list[str]:
    """Return the hash of each file, read on threads."""
    with ThreadPoolExecutor(min(8, os.cpu_count() or 1), thread_name_prefix="hash-source") as pool:
        return list(pool.map(digest, paths))


def record(folder: Path, states: dict[str, State]) -> dict[str, Any]:
    """Return what a cache keeps of files whose `states` were taken before they were opened; the first is the scene.

    Raises OSError, or ValueError where one changed meanwhile.
    """
    there = [name for name, state in states.items() if state.size >= 0]
    hashes = dict(zip(there, digests(folder / name for name in there), strict=True))
    now = time.time_ns()
    for name, state, current in zip(states, states.values(), _states(folder, states), strict=True):
        if current != state:
            raise ValueError(f"{name} changed")
    return {
        "names": list(states),
        "states": [list(state) for state in states.values()],
        "digests": [hashes.get(name, "") for name in states],
        "when_ns": now,
    }


def same(folder: Path, kept: dict[str, Any]) -> bool:
    """Whether the files of a record have the content that they had. Raises OSError where one cannot be read."""
    paths = [folder / name for name in kept["names"]]
    states = [State(*state) for state in kept["states"]]
    doubtful = []
    now = _states(folder, kept["names"])
    for path, state, current, hashed in zip(paths, states, now, kept["digests"], strict=True):
        if current.size != state.size:
            return False
        racy = max(state.changed_ns, state.entry_changed_ns) > kept["when_ns"] - RACY_NS
        if current.size >= 0 and (current != state or racy):
            doubtful.append((path, hashed))
    hashes = digests(path for path, _ in doubtful) if doubtful else []
    return hashes == [hashed for _, hashed in doubtful]


def _states(folder: Path, names: Iterable[str]) -> Iterator[State]:
    """Give the states of a scene and of what it names; the scene itself, which the user named, may be any link."""
    for number, name in enumerate(names):
        yield state_of(folder / name, folder if number else None)
