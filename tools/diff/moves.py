"""Code that was moved, not written: runs of lines that vanish in one place and appear the same in another."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

SHORTEST = 3
"""Lines, blank ones not counted, from which on the same text in two places is no accident."""

LETTERS = 40
"""Letters and digits that such a run must have: three closing brackets are an accident after all."""


@dataclass(frozen=True)
class Move:
    """`lines` lines (blank ones not counted) that stood in `old_path` and stand in `new_path`; lines count from 1."""

    old_path: str
    old_line: int
    new_path: str
    new_line: int
    lines: int


@dataclass(frozen=True)
class Placed:
    """A line with something on it: its number, and its text without indentation."""

    path: str
    number: int
    text: str


Run = list[Placed]
"""Lines of one file that changed, one after the other; blank lines between them are passed over."""


def runs(path: str, lines: Sequence[str], changed: Iterable[int]) -> list[Run]:
    """Return the runs of a file, of which the lines `changed` (from 1) were deleted or inserted.

    Imports belong to none: every file has them.
    """
    chosen, found, current = set(changed), [], Run()
    for number, line in enumerate(lines, start=1):
        text = line.strip()
        if not text:
            continue
        if number in chosen and not _IMPORT.match(text):
            current.append(Placed(path, number, text))
            continue
        found.append(current)
        current = []
    return [run for run in (*found, current) if len(run) >= SHORTEST]


_IMPORT = re.compile(r"(from|import)\s+[\w.]+|#\s*include\b")


def moves(deleted: Sequence[Run], inserted: Sequence[Run]) -> tuple[Move, ...]:
    """Return what was moved: each inserted line is the new place of one deleted line at most, the longest runs first
    in the order of the old places."""
    index: dict[tuple[str, ...], list[tuple[int, int]]] = {}
    for which, run in enumerate(inserted):
        for place in range(len(run) - SHORTEST + 1):
            index.setdefault(_key(run, place), []).append((which, place))
    taken: set[tuple[int, int]] = set()
    found = []
    for run in deleted:
        place = 0
        while place <= len(run) - SHORTEST:
            length, which, start = 0, 0, 0
            for candidate, begin in index.get(_key(run, place), ()):
                reach = _common(run, place, inserted[candidate], begin, candidate, taken)
                if reach > length:
                    length, which, start = reach, candidate, begin
            part = run[place : place + length]
            if length < SHORTEST or sum(c.isalnum() for one in part for c in one.text) < LETTERS:
                place += 1
                continue
            taken.update((which, start + step) for step in range(length))
            target = inserted[which][start]
            found.append(Move(run[place].path, run[place].number, target.path, target.number, length))
            place += length
    return tuple(found)


def _key(run: Run, place: int) -> tuple[str, ...]:
    return tuple(one.text for one in run[place : place + SHORTEST])


def _common(a: Run, i: int, b: Run, j: int, which: int, taken: set[tuple[int, int]]) -> int:
    """Return how many lines from a[i] and b[j] on are the same and not yet taken."""
    length = 0
    while (
        i + length < len(a)
        and j + length < len(b)
        and a[i + length].text == b[j + length].text
        and (which, j + length) not in taken
    ):
        length += 1
    return length
