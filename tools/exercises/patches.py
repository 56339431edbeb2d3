"""What start and solution of an exercise are: a chapter's files with patches applied, by git's `apply`."""

from __future__ import annotations

import difflib
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import chapters
from common.errors import StrataError, UserError
from common.paths import temporary_folder
from tools.exercises import Exercise
from tools.snapshots.history import call, git
from tools.snapshots.trees import Tree, put, read_tree

START, SOLUTION = "start.patch", "solution.patch"


@dataclass(frozen=True)
class States:
    """The files of a chapter at the start of an exercise, and when it is solved."""

    start: Tree
    solution: Tree


class OutOfDate(StrataError):
    """A patch does not fit the chapter any more."""


def states(exercise: Exercise, chapter: Tree | None = None) -> States:
    """Return both states; raise OutOfDate if a patch does not apply to the chapter as it is now.

    `chapter` are the chapter's files, those on disk unless they are given.
    """
    files = chapter if chapter is not None else files_of(exercise.chapter)
    start, patch = start_of(exercise, files), exercise.folder / SOLUTION
    return States(start, _applied(exercise, start, patch) if patch.is_file() else files)


def start_of(exercise: Exercise, chapter: Tree | None = None) -> Tree:
    """Return the files with which an exercise begins; raise OutOfDate as `states` does."""
    files = chapter if chapter is not None else files_of(exercise.chapter)
    patch = exercise.folder / START
    return _applied(exercise, files, patch) if patch.is_file() else files


def files_of(number: int) -> Tree:
    """Return the files of a chapter as a fork gets them."""
    return read_tree(chapters.FOLDER / chapters.folder_name(number))


def _applied(exercise: Exercise, files: Mapping[str, bytes], patch: Path) -> Tree:
    try:
        return apply(files, patch.read_bytes())
    except OutOfDate as error:
        which = "start" if patch.name == START else "solution"
        raise OutOfDate(
            f"The {which} of the exercise {exercise.spoken} does not fit chapter {exercise.chapter} any more: {error}. "
            f"Make it again in a fork of the chapter: `strata exercise {exercise.spoken} --remake {which}=FORK`."
        ) from None


def apply(files: Mapping[str, bytes], patch: bytes) -> Tree:
    """Return `files` with a patch applied; raise OutOfDate with git's own reason where it does not fit."""
    touched = {name for pair in _names(patch) for name in pair if name is not None}
    with temporary_folder() as folder:
        git(
            "init", "-q", folder=folder
        )  # else a repository around this folder would be the one that is patched
        for name in touched & files.keys():
            put(folder, name, files[name])
        done = call("apply", "--whitespace=nowarn", "-", folder=folder, stdin=patch)
        if done.returncode:
            lines = done.stderr.decode("utf-8", "replace").strip().splitlines() or ["git apply failed"]
            raise OutOfDate("; ".join(line.removeprefix("error: ") for line in lines))
        after = read_tree(folder)
    kept = {name: content for name, content in files.items() if name not in touched}
    return {**kept, **after}


def _names(patch: bytes) -> list[tuple[str | None, str | None]]:
    """Return the file's name before and after, for each file of a patch; None where there is none."""
    found = re.findall(rb"^--- ([^\t\n]+).*\n\+\+\+ ([^\t\n]+)", patch, re.M)
    return [(_name(before), _name(after)) for before, after in found]


def _name(written: bytes) -> str | None:
    text = written.decode()
    return None if text == "/dev/null" else text.partition("/")[2]


def difference(before: Mapping[str, bytes], after: Mapping[str, bytes]) -> str:
    """Return what changed as a patch; raise UserError for a file that is no text or whose last line has no end."""
    parts = []
    for name in sorted({*before, *after}):
        a, b = before.get(name), after.get(name)
        if a == b:
            continue
        old, new = _lines(name, a), _lines(name, b)
        names = ("/dev/null" if a is None else f"a/{name}", "/dev/null" if b is None else f"b/{name}")
        parts += list(difflib.unified_diff(old, new, *names))
    return "".join(parts)


def _lines(name: str, content: bytes | None) -> list[str]:
    if content is None:
        return []
    if b"\0" in content or not content.endswith(b"\n"):
        raise UserError(f"{name} cannot be part of a patch: it is no text, or its last line has no end.")
    return content.decode("utf-8").splitlines(keepends=True)
