"""`strata fork`: a reader's own copy of a chapter, in a folder anywhere on disk.

    my-ch03/
      fork.json     which chapter this is, and what it was made of
      .base/        the chapter as it was then: what later fixes are merged against, without any history
      renderer.py   and all other files, the reader's to change

A fork made inside the clone also has a .gitignore that covers all of it, so that the project's own checks pass it by.
"""

from __future__ import annotations

import json
import os
import shutil
import tempfile
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import chapters
from chapters import folders
from chapters.folders import FORMAT, RECORD, check_format
from common.errors import UserError
from common.paths import ROOT
from tools.cli.console import out, quoted, say
from tools.snapshots.history import History
from tools.snapshots.trees import Tree, digest, numbers, put, read_tree

BASE = ".base"
PROJECT = (
    "assets",
    "backends",
    "bootstrap",
    "chapters",
    "common",
    "docs",
    "shaders",
    "tests",
    "tools",
    ".git",
    ".venv",
)
"""Folders of the clone in which a fork would be taken for a part of the project."""


@dataclass(frozen=True)
class Fork:
    """A fork on disk. `made_of` is the hash of its base's files, `commit` the clone's, where it has a history.

    `conflicts` are the files that an update left with conflict markers.
    """

    number: int
    folder: Path
    made_of: str
    commit: str | None = None
    studies: bool = False
    conflicts: tuple[str, ...] = ()

    @property
    def base(self) -> Path:
        """The folder with the chapter as the fork's files began, or as its last update had it."""
        return self.folder / BASE


def run(number: int, folder: Path, *, studies: bool = False, study: str = "") -> int:
    """Make a fork and say what can be done with it, or with one study of it; return 0."""
    made = make_fork(number, folder, studies=studies)
    out.print(f"{made.folder} is chapter {number}, yours to change.", markup=False, soft_wrap=True)
    named = folders.typed(folder)
    typed = quoted(named)
    if study:
        place = made.folder / "studies" / study.replace("-", "_")
        out.print(f"The study {study} is in {place}.", markup=False, soft_wrap=True)
    what = quoted(f"{named}/{study}") if study else typed
    say(f"`strata run {what}` draws with it; change its files and look again.")
    say(f"Later fixes of the chapter come by `strata fork --update {typed}`, and what you changed stays.")
    return 0


def is_fork(folder: Path) -> bool:
    """Whether `folder` was made by `strata fork`."""
    return (folder / RECORD).is_file()


def read_fork(folder: Path) -> Fork:
    """Return what a fork says about itself; raise UserError if `folder` is none, or its record is broken."""
    if not is_fork(folder) and not folder.exists() and is_fork(folder.parent):
        whole = quoted(str(folder.parent))
        raise UserError(
            f"{folder} is no fork, and {folder.parent} is one: `strata fork --update {whole}` takes it whole."
        )
    if not is_fork(folder):
        what = "is not there" if not folder.exists() else "is no fork: it has no fork.json"
        raise UserError(f"{folder} {what}; `strata fork 1 {folder.name or 'my-ch01'}` makes one.")
    try:
        record: dict[str, Any] = json.loads((folder / RECORD).read_text("utf-8"))
        number, made_of, _ = record["chapter"], record["made_of"], record["format"]
        conflicts = tuple(record["conflicts"])
        commit, studies = record["commit"], record["studies"]
        right = isinstance(number, int) and isinstance(made_of, str) and isinstance(studies, bool)
        right = right and all(isinstance(name, str) for name in conflicts)
    except (OSError, ValueError, KeyError, TypeError):
        right = False
    if not right:
        raise UserError(
            f"{folder / RECORD} cannot be read as the record of a fork: take it from a copy, "
            "or make a new fork and put your files into it."
        )
    check_format(folder, str(folder))
    return Fork(number, folder, made_of, commit, studies, conflicts)


def write_record(fork: Fork) -> None:
    """Write a fork's fork.json."""
    put(fork.folder, RECORD, record_of(fork))


def record_of(fork: Fork) -> bytes:
    """Return the content of a fork's fork.json."""
    values = asdict(fork)
    ordered = {"format": FORMAT, "chapter": values.pop("number"), **values}
    ordered.pop("folder")
    return (json.dumps(ordered, indent=2) + "\n").encode()


def own_files(fork: Fork) -> Tree:
    """Return the files of a fork that are the reader's: all but its record and its base."""
    tree = read_tree(fork.folder, studies=True)
    tree.pop(RECORD)
    return tree


def base_files(fork: Fork) -> Tree:
    """Return the chapter's files as the fork's began; raise UserError if somebody changed them."""
    tree = read_tree(fork.base, studies=True)
    if digest(tree) != fork.made_of:
        raise UserError(
            f"{fork.base} is not what the fork was made of, so nothing can be merged: put it back from a copy, "
            "or make a new fork and put your files into it."
        )
    return tree


def make_fork(
    number: int, folder: Path, *, root: Path = chapters.FOLDER, clone: Path = ROOT, studies: bool = False
) -> Fork:
    """Copy chapter `number` of `root` into `folder`, which is new or empty, and return the fork.

    Raises UserError if the place is taken or inside the project's own folders, or the chapter is not there.
    """
    here = numbers(root)
    if number not in here:
        raise UserError(f"There is no chapter {number} in {root}.")
    place = Path(os.path.abspath(folder))
    _refuse(place, root, clone)
    tree = read_tree(here[number], studies)
    fork = Fork(number, place, digest(tree), commit_of(root), studies)
    place.parent.mkdir(parents=True, exist_ok=True)
    made = Path(tempfile.mkdtemp(dir=place.parent, prefix=f".{place.name}."))
    try:
        _write(made, tree, fork, hidden=place.resolve().is_relative_to(clone.resolve()))
        if place.exists():
            place.rmdir()  # an empty one: Windows renames onto nothing that is there
        made.rename(place)
    except BaseException:
        shutil.rmtree(made, ignore_errors=True)
        raise
    return fork


def _refuse(place: Path, root: Path, clone: Path) -> None:
    """Raise UserError where no fork can be."""
    if place.exists() and not place.is_dir():
        raise UserError(f"{place} is a file: a fork is a folder, name one that is not there yet.")
    real = place.resolve()
    within = [clone.resolve() / name for name in PROJECT] + [root.resolve()]
    if real == clone.resolve() or any(real.is_relative_to(taken) for taken in within):
        raise UserError(
            f"{place} is inside the project, whose checks would take a fork there for a part of it: "
            "name a folder beside the clone, or a new one directly in it such as my-ch01."
        )
    if place.is_dir() and any(place.iterdir()):
        whose = (
            "is a fork already: `strata fork --update` brings fixes into it"
            if is_fork(place)
            else "has files in it"
        )
        raise UserError(f"{place} {whose}; name a folder that is not there yet.")
    around = next((parent for parent in real.parents if is_fork(parent)), None)
    if around is not None:
        raise UserError(f"{place} is inside the fork {around}: name a folder outside of it.")


def _write(folder: Path, tree: Mapping[str, bytes], fork: Fork, hidden: bool) -> None:
    for name, content in tree.items():
        put(folder, name, content)
        put(folder / BASE, name, content)
    put(folder, RECORD, record_of(fork))
    if hidden:
        put(folder, ".gitignore", b"*\n")
    umask = os.umask(0)
    os.umask(umask)
    folder.chmod(0o777 & ~umask)  # mkdtemp makes folders for one user alone


def commit_of(root: Path) -> str | None:
    """Return the commit of the clone, or None where it has no history."""
    try:
        return History(root).head[:12]
    except UserError:
        return None
