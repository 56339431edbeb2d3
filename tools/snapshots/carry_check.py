"""`strata carry --check`: name lines that a commit repaired in one chapter and that are still broken in a later one.

The history of `chapters/` is read commit by commit (merges aside). A *repair* is one place that a commit changed in a
file of chapter N: lines that it replaced, removed or, between two lines, inserted, with the line before and the line
after it. A later chapter is named when all of this is so:

- before that commit it had the file already, and the same lines at the same place, with the same neighbours. So a
  chapter's history begins when it is made by copying: nothing before that counts;
- it has them still, on disk now, and chapter N has not: a repair that was taken back is none;
- the file does not belong to one chapter alone, as its `__init__.py`, its README.md, its studies and its benches do.

"At the same place" is what a line-by-line alignment of the two versions says (difflib): an equal line elsewhere in the
file is none, and lines that a lesson rewrote or moved to other neighbours are its own business. A commit that changes
both chapters, or a later one that brings the second in step, is what `strata carry` makes, and satisfies the check.
Commits that `.git-blame-ignore-revs` lists rearranged code and repaired nothing. What is wanted nevertheless,
`chapters/exceptions.toml` says with its reason.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass
from difflib import SequenceMatcher
from functools import cache, lru_cache
from pathlib import Path

from tools.cli.console import out, say
from tools.snapshots.exceptions import read_exceptions
from tools.snapshots.history import Commit, History
from tools.snapshots.merging import is_binary
from tools.snapshots.trees import belongs, numbers

Now = Callable[[Path], list[str] | None]
"""Gives the lines of a file on disk."""

Then = Callable[[str, str], list[str] | None]
"""Gives the lines of a file at a revision, by their names."""

KEPT = 64
"""So many versions of files are remembered: one serves the questions about all later chapters."""

OWN = ("__init__.py", "README.md", "lecture.toml")
"""Files of which each chapter has its own."""


@dataclass(frozen=True)
class Repair:
    """One place that a commit changed: lines `begin` to `end` of the file before it, counted from 0.

    Where there are none, it `inserted` lines.
    """

    begin: int
    end: int
    inserted: tuple[str, ...] = ()


@dataclass(frozen=True)
class Fault:
    """A repair that a later chapter lacks; `line` is where it is in that chapter's file now, counted from 1."""

    commit: Commit
    repaired: str
    broken: str
    path: str
    line: int
    text: str

    def __str__(self) -> str:
        return (
            f"{self.broken}/{self.path}:{self.line} is as {self.repaired} was before {self.commit.sha[:12]} "
            f"({self.commit.subject}): {self.text}"
        )


def run(root: Path) -> int:
    """Print what later chapters lack; return 1 if there is something, else 0.

    Raises UserError where there is no git history to look at.
    """
    found = faults(root)
    if History(root).shallow:
        say(
            "Older commits were left out of this clone and are not looked at: `git fetch --unshallow` brings them."
        )
    for fault in found:
        out.print(f"{root.name}/{fault}", markup=False, soft_wrap=True)
    if not found:
        say("Every line repaired in one chapter is repaired in the later ones that have it.")
        return 0
    first = found[0]
    say(
        f"strata: {len(found)} repaired in one chapter and not in a later one; to carry the first: "
        f"`strata carry {first.repaired} {first.path} --base {first.commit.sha[:12]}~1`, or say in "
        f"{root.name}/exceptions.toml why not."
    )
    return 1


def faults(root: Path) -> list[Fault]:
    """Return every repair that a later chapter lacks, by chapter, file and line."""
    history = History(root)
    allowed = read_exceptions(root).not_carried
    folders = numbers(root)
    names = [folder.name for folder in folders.values()]
    now = cache(lambda path: _lines(path.read_bytes() if path.is_file() else None))
    found: dict[tuple[str, str, int], Fault] = {}
    rearranging = rearranged(root)
    with history.reader() as read:
        then = lru_cache(KEPT)(lambda revision, name: _lines(read(revision, name)))
        for commit in history.commits():
            if commit.sha in rearranging:
                continue
            for changed in commit.paths:
                chapter, _, path = changed.partition("/")
                if chapter not in names or not belongs(path) or path in OWN:
                    continue
                for later in names[names.index(chapter) + 1 :]:
                    if any(entry.covers(commit.sha, path, later) for entry in allowed):
                        continue
                    for fault in _lacking(root, now, then, commit, chapter, later, path):
                        found.setdefault((later, path, fault.line), fault)
    return [found[key] for key in sorted(found)]


def rearranged(root: Path) -> frozenset[str]:
    """Return the hashes of commits that only rearranged code: those in `.git-blame-ignore-revs` beside `root`."""
    listed = root.parent / ".git-blame-ignore-revs"
    lines = listed.read_text("utf-8").splitlines() if listed.is_file() else []
    return frozenset(line.strip() for line in lines if line.strip() and not line.startswith("#"))


def _lacking(
    root: Path, now: Now, then: Then, commit: Commit, chapter: str, later: str, path: str
) -> list[Fault]:
    """Return what `commit` repaired in a file of `chapter` and `later` lacks."""
    mine, theirs = now(root / chapter / path), now(root / later / path)
    if mine is None or theirs is None or mine == theirs:
        return []  # equal files have the same repairs
    old, new = then(f"{commit.sha}~1", f"{chapter}/{path}"), then(commit.sha, f"{chapter}/{path}")
    held = then(f"{commit.sha}~1", f"{later}/{path}")
    if old is None or new is None or held is None:
        return []
    there = places(old, theirs, repairs(old, new))
    suspected = [repair for repair in there if repair in places(old, held, there)] if there else []
    left = set(suspected) - set(places(old, mine, suspected) if suspected else ())
    faults = []
    for repair in sorted(left, key=lambda repair: repair.begin):
        line = there[repair]
        if _inserted_around(theirs, line, repair.inserted):
            continue
        text = "lines are missing in front of it" if repair.begin == repair.end else theirs[line].strip()
        faults.append(Fault(commit, chapter, later, path, line + 1, text))
    return faults


def repairs(old: Sequence[str], new: Sequence[str]) -> list[Repair]:
    """Return the places of `old` that `new` changed."""
    codes = SequenceMatcher(None, old, new, autojunk=False).get_opcodes()
    return [
        Repair(begin, end, tuple(new[first:last]) if kind == "insert" else ())
        for kind, begin, end, first, last in codes
        if kind != "equal"
    ]


def places(old: Sequence[str], lines: Sequence[str], wanted: Collection[Repair]) -> dict[Repair, int]:
    """Return where `lines` hold what `old` held at each of the `wanted` places, with a neighbour on either side."""
    matcher = SequenceMatcher(
        None, ["", *old, ""], ["", *lines, ""], autojunk=False
    )  # the ends are neighbours, too
    found = {}
    for i, j, size in matcher.get_matching_blocks():
        for repair in wanted:
            if i <= repair.begin and repair.end + 2 <= i + size:
                found[repair] = j + repair.begin - i
    return found


def _inserted_around(lines: Sequence[str], at: int, inserted: tuple[str, ...]) -> bool:
    """Return whether `lines` have what was inserted before line `at`, or a few lines earlier.

    A function put between two others begins after an empty line or ends with one: which of the two is the old one, no
    alignment can say, and it may say otherwise for each chapter.
    """
    size = len(inserted)
    starts = range(max(0, at - size), at + 1) if size else ()
    return any(tuple(lines[start : start + size]) == inserted for start in starts)


def _lines(content: bytes | None) -> list[str] | None:
    if content is None or is_binary(content):
        return None
    return content.decode("utf-8", "surrogateescape").splitlines()
