"""`strata fork --update`: bring what changed in a chapter since the fork was made into the fork, by three-way merge.

What the reader changed stays. Where both changed the same lines, both stand in the file between markers, and fork.json
remembers the file until the markers are gone; the next update waits for that. The new version of the chapter becomes
the base in the same step, so nothing is left to be resumed. All files are written, or none.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import chapters
from chapters.folders import RECORD
from common.errors import UserError
from tools.cli.console import out, say
from tools.snapshots.forks import BASE, Fork, base_files, commit_of, own_files, read_fork, record_of
from tools.snapshots.merging import Labels, Step, has_markers, markers, merge_trees, show_conflict, writes
from tools.snapshots.trees import Tree, digest, numbers, read_tree, write_files

KINDS = {
    "taken": "is the chapter's new version",
    "merged": "your lines and the chapter's, merged",
    "added": "is new",
    "removed": "is gone from the chapter, and from here",
    "already": "has it already",
    "absent": "you removed it, so it stays away",
    "conflict": "conflict",
}
"""What the kinds of steps are called."""


def update(folder: Path, *, root: Path = chapters.FOLDER, dry_run: bool = False) -> int:
    """Bring a fork to what its chapter is now; return 0, or 1 if there are conflicts to resolve.

    Raises UserError if `folder` is no fork, its base was changed, its chapter is gone, or markers of an earlier
    conflict are left.
    """
    fork = read_fork(folder)
    base, ours = base_files(fork), own_files(fork)
    chapter = numbers(root).get(fork.number)
    if chapter is None:
        raise UserError(f"{folder} is a fork of chapter {fork.number}, which is not in {root}.")
    theirs = read_tree(chapter, fork.studies)
    changed = {name for name in {*base, *theirs} if base.get(name) != theirs.get(name)}
    left = sorted(name for name in {*fork.conflicts, *changed} if has_markers(ours.get(name, b"")))
    if left:
        raise UserError(
            f"{folder / left[0]} has conflict markers (lines that begin with <<<<<<<, ||||||| or >>>>>>>): "
            "resolve them, then update again."
        )
    if not changed:
        if fork.conflicts and not dry_run:
            write_files(fork.folder, {RECORD: record_of(replace(fork, conflicts=()))})
        say(f"{folder} is up to date: chapter {fork.number} is as it was when this was made or last updated.")
        return 0
    labels = Labels("yours", "the chapter as it was", f"{chapter.name} as it is now")
    steps = merge_trees(base, ours, theirs, labels)
    for step in steps:
        words = (
            f"{KINDS[step.kind]}: {step.sentence}"
            if step.sentence and step.kind == "conflict"
            else KINDS[step.kind]
        )
        out.print(f"{step.path}: {words}", markup=False, soft_wrap=True)
    if not dry_run:
        _write(fork, steps, theirs, changed, commit_of(root))
    return _explain(folder, steps, labels, dry_run)


def _write(fork: Fork, steps: Sequence[Step], theirs: Tree, changed: set[str], commit: str | None) -> None:
    conflicts = tuple(sorted(step.path for step in steps if step.marked))
    made = replace(fork, made_of=digest(theirs), commit=commit, conflicts=conflicts)
    base = {f"{BASE}/{name}": theirs.get(name) for name in sorted(changed)}
    write_files(fork.folder, {**writes(steps), **base, RECORD: record_of(made)})


def _explain(folder: Path, steps: Sequence[Step], labels: Labels, dry_run: bool) -> int:
    """Say how it went; return the exit code."""
    conflicts = [step for step in steps if step.kind == "conflict"]
    for step in conflicts:
        out.print()
        if step.marked:
            out.print(f"{folder / step.path}:", markup=False, soft_wrap=True)
            for line in show_conflict(step.content or b""):
                out.print(line, markup=False, soft_wrap=True)
        else:
            where = folder / BASE / step.path
            said = f"{folder / step.path} is as you had it; the chapter's version, if it has one, is {where}."
            out.print(said, markup=False, soft_wrap=True)
    if any(step.marked for step in conflicts):
        out.print()
        out.print(markers(labels), markup=False, soft_wrap=True)
    count = len(writes(steps))
    files = f"{count} file{'' if count == 1 else 's'}"
    places = f"{len(conflicts)} with a conflict" if conflicts else "no conflict"
    if dry_run:
        say(f"Nothing was written; {files} would be, {places}.")
    else:
        say(f"{folder} has what changed in its chapter: {files} written, {places}.")
    return 1 if conflicts else 0
