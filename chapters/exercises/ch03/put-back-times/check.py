"""A scene's file is replaced by one of the same size, with its time of change put back: is the cache believed?"""

from __future__ import annotations

import os
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from tools.exercises.checking import Given

LATER_NS = 60 * 10**9
OLD, NEW = b"one scene", b"other one"


def check(given: Given) -> None:
    """Ask for files that are as they were, touched, and replaced."""
    sources: Any = given.module("scene_cache.sources")
    with TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "scene.bin").write_bytes(OLD)
        kept = _record(sources, folder)
        hashed = _hashed(
            sources, lambda: given.need(sources.same(folder, kept), "A file as it was is refused.")
        )
        given.need(
            not hashed,
            "A file that nobody wrote to is read and hashed all the same: that costs what a cache saves.",
        )
        state = (folder / "scene.bin").stat()
        os.utime(folder / "scene.bin", ns=(state.st_atime_ns, state.st_mtime_ns + LATER_NS))
        given.need(sources.same(folder, kept), "A file of another time and the same content is refused.")
        _replace(folder, NEW, state)
        given.need(
            not sources.same(folder, kept),
            "A file was replaced by another one of the same size, with its time of change put back, and the cache of "
            "the old one is believed.",
        )
        (folder / "scene.bin").unlink()
        given.need(not sources.same(folder, kept), "A file is gone, and the cache is believed.")


def _record(sources: Any, folder: Path) -> dict[str, Any]:
    """Return what a cache keeps of the file, as if it had been written a minute after it."""
    kept: dict[str, Any] = sources.record(folder, {"scene.bin": sources.state_of(folder / "scene.bin")})
    return kept | {"when_ns": kept["when_ns"] + LATER_NS}


def _replace(folder: Path, content: bytes, state: os.stat_result) -> None:
    """Put another file in the place of the first, as `rsync --times` and `tar` do."""
    (folder / "new").write_bytes(content)
    os.utime(folder / "new", ns=(state.st_atime_ns, state.st_mtime_ns))
    os.replace(folder / "new", folder / "scene.bin")


def _hashed(sources: Any, work: Any) -> list[Path]:
    """Return the files that are hashed while `work` runs."""
    digest, seen = sources.digest, list[Path]()

    def watched(path: Path) -> str:
        seen.append(path)
        found: str = digest(path)
        return found

    sources.digest = watched
    try:
        work()
    finally:
        sources.digest = digest
    return seen
