"""An audit hook that tells of every file which is opened outside of where a scene may lead.

What is allowed, and nothing else: the scene's own folder, the clone, the caches (STRATA_CACHE, STRATA_VERDICTS), the
Python installation with its packages, `DEVICES`, and the folder for results that the worker names. Paths count by
where their links lead. In the scene's folder, too, only regular files and folders may be opened: a pipe has no end.
The only programs that may be started are this Python and `PROGRAMS`.

The hook sees what Python opens (`open`, `os.open`, `os.listdir`, `os.scandir`, sockets, programs), not what the C code
of a driver opens by itself.
"""

from __future__ import annotations

import os
import stat
import sys
from collections.abc import Callable, Iterable
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from backends.selftest import verdicts
from common.paths import ROOT, user_cache

OPENING = {"open", "os.listdir", "os.scandir"}
STARTING = {"subprocess.Popen", "os.exec", "os.posix_spawn", "os.spawn"}
FORBIDDEN = {"os.system", "socket.connect", "socket.bind", "socket.getaddrinfo", "urllib.Request"}
DEVICES = {"/dev/null", "/dev/urandom"}
PROGRAMS = {"/sbin/ldconfig"}
"""ctypes asks it where the library of a driver lies."""


class Guard:
    """Tells `report` of every opening that is not allowed, while it watches; `install` cannot be undone."""

    def __init__(self, report: Callable[[str], None], results: Path) -> None:
        self._report = report
        self._folder: str | None = None
        installed = {sys.prefix, sys.base_prefix, sys.exec_prefix, *sys.path[1:]}
        self._allowed = _folders(
            [str(ROOT), str(user_cache()), str(verdicts.folder()), str(results), *installed]
        )

    def install(self) -> None:
        """Add the hook to this interpreter."""
        sys.addaudithook(self._hear)

    @contextmanager
    def watching(self, folder: Any) -> Any:
        """Watch while a scene in `folder` is opened."""
        self._folder = os.path.realpath(folder)
        try:
            yield
        finally:
            self._folder = None

    def _hear(self, event: str, args: tuple[Any, ...]) -> None:
        folder = self._folder
        if folder is None:
            return
        if event in FORBIDDEN:
            self._report(f"{event} {args!r:.200}")
        elif event in STARTING:
            if str(args[0]) not in {sys.executable, *PROGRAMS}:
                self._report(f"{event} {args!r:.200}")
        elif event in OPENING and args and isinstance(args[0], str | bytes | os.PathLike):
            path = os.fsdecode(os.fspath(args[0]))
            fault = self._fault(path, folder)
            if fault:
                self._report(f"{event} {path!r}, {fault}")

    def _fault(self, path: str, folder: str) -> str:
        try:
            led = os.path.realpath(path)
            if led in DEVICES:
                return ""
            if not any(is_below(led, place) for place in (folder, *self._allowed)):
                return "outside the scene's folder"
            mode = os.stat(led).st_mode
        except (OSError, ValueError):  # there is no such file
            return ""
        return "" if stat.S_ISREG(mode) or stat.S_ISDIR(mode) else "no regular file"


def is_below(path: str, folder: str) -> bool:
    """Whether `path` is `folder` or in it; both are absolute, without links."""
    return path == folder or path.startswith(folder.rstrip(os.sep) + os.sep)


def _folders(paths: Iterable[str]) -> tuple[str, ...]:
    found = dict.fromkeys(os.path.realpath(path) for path in paths if path)
    return tuple(path for path in found if path != os.sep)
