"""The files that shaders are built from: read, split into lines, and kept in memory while they are edited.

A file is analysed again only where it changed on disk. Within `pinned` not even then: a program that runs while its
shaders are edited goes on with the texts it began with, until `refreshed` lets new ones in.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

from common.errors import ShaderError
from common.paths import ROOT

_DIRECTIVE = re.compile(r"\s*#\s*(include|version|define|undef|ifdef|ifndef|if|elif|else|endif)\b\s*(.*)")
_COMMENT = re.compile(r"//.*|/\*.*?(?:\*/|$)")


class State(NamedTuple):
    """What tells one version of a file from the next: editors write in place, or rename a new file over the old."""

    modified_ns: int
    changed_ns: int  # of its rights too: a file that can be read again is worth a look
    size: int
    inode: int


class Part(NamedTuple):
    """Some lines without a directive, what a compiler makes something of among them, and the directive behind them.

    That is None at the end of a file; `own` is what a compiler sees of its line, `number` is its line's, from 1.
    """

    lines: tuple[str, ...]
    code: tuple[str, ...]
    directive: re.Match[str] | None
    own: str
    number: int


@dataclass(frozen=True)
class File:
    """A file before expansion; `folder` is None for text that lies nowhere on disk.

    `identity` tells files apart, however a path leads to them; `parts` are cut where a directive stands outside
    comments, since a shader's text is put together from whole parts.
    """

    name: str
    folder: Path | None
    identity: str
    lines: tuple[str, ...] = field(repr=False)
    parts: tuple[Part, ...] = field(repr=False)


_Read = tuple[State, Any]
_analysed: dict[Path, _Read] = {}
"""Each file as it was last read: a chapter's shaders include the same ones over and over."""

_pinned: dict[Path, _Read | None] | None = None
"""Within `pinned`: what every shader is built from, whatever lies on disk by now; None where no file was."""

T = TypeVar("T")


@contextmanager
def pinned() -> Iterator[None]:
    """Within, a file keeps the text that it had when it was first read, until `refreshed` reads it again.

    Then pipelines that are built late fit those that were built early, and a file that is wrong for a while, or gone,
    stops nothing.
    """
    global _pinned
    before, _pinned = _pinned, {}
    try:
        yield
    finally:
        _pinned = before


@contextmanager
def refreshed(paths: Collection[Path]) -> Iterator[None]:
    """Within `pinned`, read these files again; an exception brings back the texts that they had before."""
    global _pinned
    before = _pinned
    if before is not None:
        _pinned = {path: read for path, read in before.items() if path not in paths}
    for path in paths:
        _analysed.pop(path, None)  # two edits of one size may fall into one tick of a file system's clock
    try:
        yield
    except BaseException:
        _pinned = before
        raise


def state_of(path: Path) -> State | None:
    """Return the state of a file on disk; None where there is none, or none that can be looked at."""
    try:
        stat = path.stat()
    except (OSError, ValueError):  # ValueError: a zero byte in the name
        return None
    return State(stat.st_mtime_ns, stat.st_ctime_ns, stat.st_size, stat.st_ino)


def state_read(path: Path) -> State | None:
    """Return the state in which shaders found a file; or its present state if no shader used the file yet."""
    if _pinned is not None and path in _pinned:
        read = _pinned[path]
        return read[0] if read else None
    return state_of(path)


def looked_for() -> frozenset[Path]:
    """Return every file that shaders asked for within `pinned`, also those that were not there."""
    return frozenset(_pinned or ())


def is_there(path: Path) -> bool:
    """Whether shaders can include a file."""
    if _pinned is None:
        return path.is_file()
    if path not in _pinned and not path.is_file():
        _pinned[path] = None
    return _pinned.get(path, True) is not None


def load(path: Path) -> File:
    """Return a file; raise ShaderError where it cannot be read or is no text."""
    if _pinned is not None and (held := _pinned.get(path)) is not None:
        shader: File = held[1]
        return shader
    try:
        stat = path.stat()
    except OSError as error:
        raise ShaderError(
            f"The shader {shown_path(path)} cannot be read: {error.strerror or error}."
        ) from None
    state = State(stat.st_mtime_ns, stat.st_ctime_ns, stat.st_size, stat.st_ino)
    read = _analysed.get(path)
    if read is None or read[0] != state:
        read = state, _split(shown_path(path), _text(path), path.parent, str(path.resolve()))
        _analysed[path] = read
    if _pinned is not None:
        _pinned[path] = read
    text: File = read[1]
    return text


def held(path: Path, read: Callable[[Path], T]) -> T:
    """Return what `read` makes of a file that is no shader and is edited like one: within `pinned`, once."""
    if _pinned is not None and (known := _pinned.get(path)) is not None:
        before: T = known[1]
        return before
    state = state_of(path)  # before it is read: an edit that comes meanwhile is then noticed
    lines = read(path)
    if _pinned is not None and state is not None:
        _pinned[path] = state, lines
    return lines


@lru_cache(64)
def in_memory(name: str, text: str) -> File:
    """Return text that lies nowhere on disk as a file called `name`."""
    return _split(name, text, None, name)


def _split(name: str, text: str, folder: Path | None, identity: str) -> File:
    lines = lines_of(text)
    bare = _without_comments(lines)
    directives, code = map(_DIRECTIVE.match, bare), tuple(_code(lines, bare))
    return File(name, folder, identity, lines, tuple(_parts(lines, code, directives)))


def _parts(
    lines: Sequence[str], code: Sequence[str], directives: Iterable[re.Match[str] | None]
) -> Iterator[Part]:
    begin = 0
    for place, directive in enumerate((*directives, None)):
        if directive is not None or place == len(lines):
            own = code[place] if directive is not None else ""
            said = tuple(filter(None, code[begin:place]))
            yield Part(tuple(lines[begin:place]), said, directive, own, place + 1)
            begin = place + 1


def _code(lines: Sequence[str], bare: Sequence[str]) -> Iterator[str]:
    """Yield each line without its comments, as which `bare` has it, and without what is spaces alone."""
    continued = False
    for line, without in zip(lines, bare, strict=True):
        continues = line.endswith("\\")  # a macro, or even a comment, goes on: then every space may count
        yield f"{line}\n" if continues or continued else " ".join(without.split())
        continued = continues


def _without_comments(lines: Sequence[str]) -> list[str]:
    """Return the lines without their comments, so that an include in a comment is none."""
    result = []
    inside = False
    for line in lines:
        if inside:
            _, end, line = line.partition("*/")
            inside = not end
        comments = _COMMENT.findall(line)
        if (
            comments
            and comments[-1].startswith("/*")
            and (len(comments[-1]) < 4 or not comments[-1].endswith("*/"))
        ):
            inside = True
        result.append(_COMMENT.sub(" ", line))
    return result


def lines_of(text: str) -> tuple[str, ...]:
    """Return the lines of `text` without its byte-order mark, as a compiler counts them (no form feeds)."""
    text = text.removeprefix("\ufeff").replace("\r\n", "\n").removesuffix("\n")
    return tuple(text.split("\n"))


def _text(path: Path) -> str:
    """Return a file's text with LF line ends."""
    try:
        text = path.read_text(encoding="utf-8")
    except OSError as error:
        raise ShaderError(
            f"The shader {shown_path(path)} cannot be read: {error.strerror or error}."
        ) from None
    except UnicodeDecodeError:
        raise ShaderError(f"The shader {shown_path(path)} is not UTF-8 text.") from None
    if "\0" in text:
        raise ShaderError(f"The shader {shown_path(path)} is not text: it has a zero byte.")
    return text


def shown_path(path: Path) -> str:
    """Return `path` as messages show it: from the repository's root where it lies inside."""
    path = path.resolve()
    return path.relative_to(ROOT).as_posix() if path.is_relative_to(ROOT) else str(path)
