"""The files of a chapter as a table of bytes: reading it, hashing it, and writing a set of files, all or none."""

from __future__ import annotations

import hashlib
import re
import stat
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from common.errors import StrataError, UserError
from common.lessons import Lesson
from common.paths import write_whole

Tree = dict[str, bytes]
"""Content by path, relative to the chapter's folder, with "/" between its parts."""

STAR = ("studies", "benches")
"""The folders of a chapter that are never copied to the next one."""


def numbers(root: Path) -> dict[int, Path]:
    """Return the folders of the chapters in `root` by number, in that order: ch10 comes behind ch02."""
    found = {int(match[1]): path for path in root.iterdir() if (match := re.fullmatch(r"ch(\d+)", path.name))}
    return {number: found[number] for number in sorted(found) if found[number].is_dir()}


def lesson_of(folder: Path) -> Lesson:
    """Return what a chapter in `folder` says about itself; raise StrataError if its `__init__.py` says nothing.

    Only that file is run, so a folder anywhere can be asked.
    """
    path = folder / "__init__.py"
    said: dict[str, Any] = {"__name__": folder.name, "__file__": str(path)}
    try:
        exec(compile(path.read_bytes(), str(path), "exec"), said)
    except Exception as error:
        raise StrataError(f"{path} does not run: {type(error).__name__}: {error}.") from error
    if not isinstance(said.get("LESSON"), Lesson):
        raise StrataError(f"{path} has no LESSON = Lesson(...).")
    return said["LESSON"]


def belongs(path: str, studies: bool = False) -> bool:
    """Whether a file at this place is the chapter's: nothing hidden, nothing made by running, `STAR` if asked for."""
    parts = path.split("/")
    made = any(part.startswith(".") or part in ("__pycache__", "out") for part in parts)
    return not made and (studies or parts[0] not in STAR)


def read_tree(folder: Path, studies: bool = False) -> Tree:
    """Return the files of a chapter or a fork."""
    tree = {}
    for path in sorted(folder.rglob("*")):
        name = path.relative_to(folder).as_posix()
        if belongs(name, studies) and path.is_file():
            tree[name] = path.read_bytes()
    return tree


def digest(tree: Mapping[str, bytes]) -> str:
    """Return a hash of names and contents, 40 hexadecimal digits."""
    made = hashlib.sha256()
    for name in sorted(tree):
        for part in (name.encode(), tree[name]):
            made.update(len(part).to_bytes(8, "little") + part)
    return made.hexdigest()[:40]


def write_files(folder: Path, files: Mapping[str, bytes | None]) -> None:
    """Write `files` below `folder` (None: remove), all or none; folders that become empty go.

    Raises UserError if one of them cannot be written; then those before it are as they were.
    """
    before: dict[str, bytes | None] = {}
    name = ""
    try:
        for name, content in files.items():
            path = folder / name
            before[name] = path.read_bytes() if path.is_file() else None
            put(folder, name, content)
    except BaseException as error:
        for written, content in before.items():
            if (folder / written).is_file() or content is not None:
                put(folder, written, content)
        if not isinstance(error, OSError):
            raise
        why = error.strerror or str(error)
        raise UserError(f"{folder / name} cannot be written ({why}); nothing was changed.") from None


def put(folder: Path, name: str, content: bytes | None) -> None:
    """Write one file whole, keeping its mode, or remove it and the folders that it leaves empty."""
    path = folder / name
    if content is None:
        path.unlink(missing_ok=True)
        for parent in path.relative_to(folder).parents:
            left = folder / parent
            if parent == Path(".") or not left.is_dir() or any(left.iterdir()):
                return
            left.rmdir()
        return
    if path.is_file() and path.read_bytes() == content:
        return
    mode = stat.S_IMODE(path.stat().st_mode) if path.is_file() else None
    path.parent.mkdir(parents=True, exist_ok=True)
    write_whole(path, content)
    if mode is not None:
        path.chmod(mode)
