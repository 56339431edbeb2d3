"""Files that a scene or a command names are opened only if they are regular: a pipe blocks, a device need not end."""

from __future__ import annotations

import errno
import os
import stat
from io import BufferedReader
from pathlib import Path

NOT_REGULAR = "it is a pipe or a device, not a regular file"

# Without O_NONBLOCK, opening a pipe waits for its other end; Windows lacks the flag and names no pipe by a path.
_FLAGS = os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_CLOEXEC", 0) | getattr(os, "O_BINARY", 0)


def open_regular(path: str | os.PathLike[str]) -> BufferedReader:
    """Open a regular file to read its bytes; symbolic links are followed.

    The path is asked first, because opening some devices has an effect, and then the open file, because another one
    may have taken the path meanwhile.

    Raises:
        OSError: there is no such file, it may not be read, or it is a folder, a pipe, a socket or a device.
        ValueError: the path holds a null character, or one that no file name can hold.
    """
    _check(os.stat(path), path)
    descriptor = os.open(path, _FLAGS)
    try:
        _check(os.fstat(descriptor), path)
        return os.fdopen(descriptor, "rb")
    except BaseException:
        os.close(descriptor)
        raise


def read_regular(path: str | os.PathLike[str], count: int = -1) -> bytes:
    """Return the bytes of a regular file, the first `count` of them where that is not negative.

    Raises:
        OSError, ValueError: as `open_regular`.
    """
    with open_regular(path) as stream:
        return stream.read(count)


def leads_outside(path: Path, folder: Path) -> bool:
    """Whether a link on the way from `folder` to `path`, a path below it without "..", leads out of that folder.

    A path that cannot be followed (a loop of links, no permission, a null character) does not: opening it says what
    is wrong.
    """
    try:
        # A name without ".." leads outside by a link alone, and to follow all folders up to the root takes long.
        below = [folder]
        for part in path.relative_to(folder).parts:
            below.append(below[-1] / part)
        linked = os.name == "nt" or any(map(os.path.islink, below[1:]))
        return linked and not path.resolve().is_relative_to(folder.resolve())
    except (OSError, ValueError, RuntimeError):
        return False


def _check(state: os.stat_result, path: str | os.PathLike[str]) -> None:
    if stat.S_ISDIR(state.st_mode):
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), os.fspath(path))
    if not stat.S_ISREG(state.st_mode):
        raise OSError(errno.EINVAL, NOT_REGULAR, os.fspath(path))
