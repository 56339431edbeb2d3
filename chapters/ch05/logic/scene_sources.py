"""The files that a scene is made of, and whether they still say what they said when a cache was made of them.

What counts is content: a cache is good as long as the bytes of every file are the same, wherever they were copied from.
Reading 500 MB to find that out would cost a good part of what the cache saves, so the file system is asked first: size,
time of change, time of change of the entry and number of the file. If all are as they were, nobody wrote to the file;
the third cannot be set by a program, so a tool that puts the old time back (rsync, tar, touch) is seen. Clocks of file
systems are coarse: where a file was written within two seconds of being hashed, it may have changed again without a
trace, and its content is hashed every time.
"""

from __future__ import annotations

import hashlib
import json
import os
import time
from collections.abc import Iterable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any, NamedTuple
from urllib.parse import unquote

from common.gltf.container import open_container
from common.gltf.refusal import Refusal

RACY_NS = 2_000_000_000
"""Two seconds: the coarsest clock of a file system in use (FAT)."""

ABSENT = (-1, 0, 0, 0)


class State(NamedTuple):
    """What the file system says of a file; `ABSENT` where there is none."""

    size: int
    changed_ns: int
    entry_changed_ns: int
    number: int


def state_of(path: Path) -> State:
    """Return the state of a file; one that cannot be asked for is absent."""
    try:
        found = path.stat()
    except (OSError, ValueError):
        return State(*ABSENT)
    return State(found.st_size, found.st_mtime_ns, found.st_ctime_ns, found.st_ino)


def source_names(path: Path) -> list[str]:
    """Return the files of a scene, relative to its folder: itself first, then what its buffers and images name.

    Where a name can be read in two ways both are there, as in `common.gltf.container.read_uri`. Raises OSError or
    ValueError where the file changed into something that is no glTF.
    """
    try:
        root = json.loads(open_container(path).text.tobytes().decode("utf-8-sig"))
        entries = [entry for kind in ("buffers", "images") for entry in root.get(kind) or []]
        uris = [entry["uri"] for entry in entries if entry.get("uri")]
    except (Refusal, AttributeError, TypeError, RecursionError) as error:
        raise ValueError(str(error)) from None
    names = {path.name: None}
    for uri in uris:
        if uri[:5].lower() != "data:":
            names.update(dict.fromkeys((unquote(uri), uri)))
    return list(names)


def digest(path: Path) -> str:
    """Return a hash of a file's bytes, "" where there is none."""
    try:
        with path.open("rb") as stream:
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
    """Return what a cache keeps of the files in `states`. Raises OSError, or ValueError where one changed meanwhile."""
    hashes = digests(folder / name for name in states)
    now = time.time_ns()
    for name, state in states.items():
        if state_of(folder / name) != state:
            raise ValueError(f"{name} changed")
    return {
        "names": list(states),
        "states": [list(state) for state in states.values()],
        "digests": hashes,
        "when_ns": now,
    }


def same(folder: Path, kept: dict[str, Any]) -> bool:
    """Whether the files of a record have the content that they had. Raises OSError where one cannot be read."""
    paths = [folder / name for name in kept["names"]]
    states = [State(*state) for state in kept["states"]]
    doubtful = []
    for path, state, hashed in zip(paths, states, kept["digests"], strict=True):
        found = state_of(path)
        if found.size != state.size:
            return False
        racy = max(state.changed_ns, state.entry_changed_ns) > kept["when_ns"] - RACY_NS
        if found.size >= 0 and (found != state or racy):
            doubtful.append((path, hashed))
    hashes = digests(path for path, _ in doubtful) if doubtful else []
    return hashes == [hashed for _, hashed in doubtful]
