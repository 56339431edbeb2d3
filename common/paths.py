"""Where Strata finds its own files and where it may write: never the current directory."""

from __future__ import annotations

import os
import shutil
import stat
import sys
import tempfile
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import BinaryIO

ROOT = Path(__file__).resolve().parents[1]
"""The clone: `chapters/`, `shaders/`, `assets/` are beside each other here."""


def _current() -> str:
    try:
        return os.getcwd()
    except OSError:  # it was removed
        return str(ROOT)


START = _current()
"""The folder that was the current one at the start: relative paths in the environment count from it."""


def user_cache() -> Path:
    """Return the folder for everything that can be made again (not created); `STRATA_CACHE` overrides it."""
    if chosen := os.environ.get("STRATA_CACHE"):
        return _from_start(chosen)
    if sys.platform == "win32":
        return Path(os.environ.get("LOCALAPPDATA", Path.home() / "AppData" / "Local")) / "strata"
    if sys.platform == "darwin":
        return Path.home() / "Library" / "Caches" / "strata"
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "strata"


def user_state() -> Path:
    """Return the folder for what the user has done (not created); `STRATA_STATE` overrides it.

    It cannot be made again, so it is not in the cache, which may be deleted at any time.
    """
    if chosen := os.environ.get("STRATA_STATE"):
        return _from_start(chosen)
    if sys.platform == "win32":
        return Path(os.environ.get("APPDATA", Path.home() / "AppData" / "Roaming")) / "strata"
    if sys.platform == "darwin":
        return Path.home() / "Library" / "Application Support" / "strata"
    return Path(os.environ.get("XDG_STATE_HOME") or Path.home() / ".local" / "state") / "strata"


def _from_start(text: str) -> Path:
    """Return the folder that an environment variable names, from the folder of the start."""
    return Path(os.path.abspath(os.path.join(START, os.path.expanduser(text))))


def cache_dir(name: str) -> Path | None:
    """Return the writable cache folder `name`, created if need be, or None where nothing can be written.

    A read-only or full disk must cost speed, never the picture: callers work without a cache when this is None.
    """
    folder = user_cache() / name
    return None if _refusal(folder) else folder


def cache_problem() -> str:
    """Return why nothing can be kept in the cache, as the end of a sentence, or ""."""
    folder = user_cache()
    refusal = _refusal(folder)
    return f"{folder} cannot be written ({refusal}), so nothing is kept from run to run" if refusal else ""


def _refusal(folder: Path) -> str:
    """Create `folder` and try to write to it; return what the system says to that, or ""."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            return ""
    except OSError as error:
        return error.strerror or str(error)


LONGEST_NAME = 255 - len(".abcdefgh.")
"""Bytes of a name at most: the file is made under a name that is so much longer (`WholeFile`)."""


def write_problem(path: Path) -> str:
    """Return why `write_whole` would write no file `path`, as the end of a sentence, or "".

    To be asked before the work. A pipe would wait for its reader, with all work done. A character device, as /dev/null,
    takes what comes.
    """
    try:
        mode = os.stat(path).st_mode
    except FileNotFoundError:
        mode = stat.S_IFREG  # it will be one
    except (OSError, ValueError) as error:  # a loop of links, a name that is too long
        return getattr(error, "strerror", None) or str(error)
    if stat.S_ISCHR(mode):
        return ""
    if not stat.S_ISREG(mode):
        return (
            "it is a folder"
            if stat.S_ISDIR(mode)
            else "it is a pipe, a socket or a device, not a regular file"
        )
    file = written_file(path.absolute())
    if len(os.fsencode(file.name)) > LONGEST_NAME:
        return f"its name is longer than {LONGEST_NAME} bytes"
    folder = file.parent
    return folder_problem(folder) if folder.is_dir() else f"there is no folder {folder}"


def folder_problem(folder: Path) -> str:
    """Return why no file can be made in a folder, which may have to be made itself, as the end of a sentence, or "".

    Only an attempt shows that: rights say nothing in file systems such as /proc.
    """
    there = folder.absolute()
    while not os.path.lexists(there) and there != there.parent:
        there = there.parent
    if not there.is_dir():
        return f"{there} is no folder"
    try:
        with tempfile.TemporaryFile(dir=there):
            return ""
    except OSError as error:
        return f"no file can be made in {there} ({error.strerror or error})"


def written_file(path: Path) -> Path:
    """Return the file that `write_whole` creates or replaces for `path`: where its symbolic links lead."""
    return Path(os.path.realpath(path)) if path.is_symlink() else path


_unfinished: set[str] = set()
"""Temporary files and folders that are there now."""


def write_whole(path: Path, data: bytes) -> None:
    """Write `data` so that a reader of `path` sees the old file or the new one, never a part (write, then rename).

    A symbolic link stays one, and the file that it names is written. What is neither file nor folder, as a pipe or
    /dev/null, is written to in place. Raises OSError, whose `filename` is `path`.
    """
    with _naming(path):
        if path.exists() and not path.is_file() and not path.is_dir():
            path.write_bytes(data)
            return
        file = WholeFile(path)
        try:
            file.stream.write(data)
            file.keep()
        finally:
            file.drop()


@contextmanager
def _naming(path: Path) -> Iterator[None]:
    """Have an OSError name `path`: that of a full disk names no file, others a temporary one."""
    try:
        yield
    except OSError as error:
        error.filename, error.filename2 = str(path), None
        raise


class WholeFile:
    """A file written in steps to `stream`, which is invisible before `keep` puts it in the place of `path`.

    `drop` removes what was not kept, and does nothing otherwise. Both raise OSError, as writing to `stream` does.
    """

    def __init__(self, path: Path) -> None:
        self.path = written_file(path)
        handle, self._temporary = tempfile.mkstemp(dir=self.path.parent, prefix=f".{self.path.name}.")
        _unfinished.add(self._temporary)
        self.stream: BinaryIO = os.fdopen(handle, "wb")

    def keep(self) -> None:
        """Put the file in its place."""
        self.stream.close()
        os.chmod(self._temporary, 0o666 & ~_umask())
        os.replace(self._temporary, self.path)
        _unfinished.discard(self._temporary)

    def drop(self) -> None:
        """Remove the file unless it was kept."""
        if self._temporary not in _unfinished:
            return
        with suppress(OSError):
            self.stream.close()  # what was not written yet may still find the disk full
        Path(self._temporary).unlink(missing_ok=True)
        _unfinished.discard(self._temporary)


@contextmanager
def temporary_folder() -> Iterator[Path]:
    """Give a folder that is gone with all it holds on leaving."""
    with tempfile.TemporaryDirectory(prefix="strata-") as folder:
        _unfinished.add(folder)
        try:
            yield Path(folder)
        finally:
            _unfinished.discard(folder)


def remove_unfinished() -> None:
    """Remove what `write_whole` has begun, and temporary folders: for a process that ends without unwinding."""
    for left in list(_unfinished):
        if os.path.isdir(left):
            shutil.rmtree(left, ignore_errors=True)
        else:
            Path(left).unlink(missing_ok=True)


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask


def asset_dir() -> Path | None:
    """Return the folder of real models made elsewhere (`STRATA_ASSETS`, else `../shared/assets`), or None."""
    chosen = os.environ.get("STRATA_ASSETS")
    folder = Path(chosen) if chosen else ROOT.parent / "shared" / "assets"
    return folder if folder.is_dir() else None


def matched(patterns: Iterable[str], root: Path = ROOT) -> list[Path]:
    """Return the files below `root` that paths and globs name, each once, in the order of their paths.

    Raises FileNotFoundError for one that names nothing: a table whose files moved would lose them silently.
    """
    files_found: set[Path] = set()
    for pattern in patterns:
        files = [path for path in root.glob(pattern) if path.is_file()]
        if not files:
            raise FileNotFoundError(f"no file of {root} matches {pattern}")
        files_found.update(files)
    return sorted(files_found)
