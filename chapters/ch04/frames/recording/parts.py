"""Draws in parts: what a pass records, written down first, so that several threads can each record a piece of it.

    draws = DrawList(multi_draw=True)
    forward.record(draws)  # nothing is recorded yet: groups and what is bound for them stand in a list
    for first, last in split(draws.calls, part_count(draws.calls, least=256)):
        draws.record(commands_of(first), first, last)  # by any thread, into commands of its own

The unit is the call that draws, since calls are what recording costs: with indirect draws a group of a thousand
objects is one, without them it is a thousand, and is cut in the middle. Every part binds all that its own calls need.
"""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from collections.abc import Sequence
from dataclasses import replace
from itertools import accumulate
from typing import Any


def pool_index(frame: int, thread: int, threads: int) -> int:
    """Return the number of the pool that belongs to a frame slot and to one of so many threads."""
    if not 0 <= thread < threads or frame < 0:
        raise ValueError(f"frame {frame} and thread {thread} of {threads} have no pool")
    return frame * threads + thread


def part_count(calls: int, least: int) -> int:
    """Return into how many parts so many calls are cut, of `least` calls or more each; 0 where two cannot be made."""
    parts = calls // least
    return parts if parts > 1 else 0


class Groups:
    """Groups of draws (either backend's `DrawGroup`) whose calls are numbered from `first` on."""

    def __init__(self, groups: Sequence[Any], multi_draw: bool, first: int = 0) -> None:
        self._groups, self._first = groups, first
        calls = (1 if multi_draw else group.batch.count for group in groups)
        self._ends = list(accumulate(calls, initial=first))[1:]
        self.end = self._ends[-1] if self._ends else first
        """The number behind that of the last call."""

    def part(self, first: int, last: int) -> list[Any]:
        """Return the groups of calls [first, last), of which there is one at least; those at its ends may be cut."""
        low, high = bisect_right(self._ends, first), bisect_left(self._ends, last)
        found = list(self._groups[low : high + 1])
        if last < self._ends[high]:  # the tail first: cut groups keep the number of their first draw
            found[-1] = _cut(found[-1], 0, found[-1].batch.count - (self._ends[high] - last))
        start = self._ends[low - 1] if low else self._first
        if first > start:
            found[0] = _cut(found[0], first - start, found[0].batch.count)
        return found


def _cut(group: Any, begin: int, end: int) -> Any:
    """Return draws [begin, end) of a group. Its triangles count where its first draw is: their sum stays right."""
    batch = group.batch
    triangles = batch.triangles if begin == 0 else 0
    return replace(
        group, batch=replace(batch, first=batch.first + begin, count=end - begin, triangles=triangles)
    )


class DrawList:
    """Has the methods of a backend's `Commands` with which passes record, and writes down what they are asked for."""

    def __init__(self, multi_draw: bool) -> None:
        self._multi_draw = multi_draw
        self._steps: list[tuple[int, int, Groups | None, tuple[Any, ...]]] = []
        self._state: list[tuple[str, tuple[Any, ...]]] = []
        self.calls = 0
        """How many calls draw."""

    def bind_pipeline(self, *arguments: Any) -> None:
        """Write down a pipeline for the draw that comes next."""
        self._state.append(("bind_pipeline", arguments))

    def bind_set(self, *arguments: Any) -> None:
        """Write down a descriptor set for the draw that comes next."""
        self._state.append(("bind_set", arguments))

    def draw_fullscreen(self, *arguments: Any) -> None:
        """Write down a triangle with all that was bound for it: no part begins between them."""
        self._add(None, self.calls + 1, (*self._state, ("draw_fullscreen", arguments)))
        self._state.clear()

    def draw_groups(self, groups: Sequence[Any], *arguments: Any) -> None:
        """Write down groups of draws, and the other arguments with which they are recorded."""
        found = Groups(groups, self._multi_draw, self.calls)
        self._add(found, found.end, arguments)

    def _add(self, groups: Groups | None, end: int, what: tuple[Any, ...]) -> None:
        self._steps.append((self.calls, end, groups, what))
        self.calls = end

    def record(self, commands: Any, first: int, last: int) -> None:
        """Record calls [first, last), in their order, and all that they need, into the backend's `commands`."""
        for start, end, groups, what in self._steps:
            begin, stop = max(first, start), min(last, end)
            if begin >= stop:
                continue
            if groups is not None:
                commands.draw_groups(groups.part(begin, stop), *what)
                continue
            for name, arguments in what:
                getattr(commands, name)(*arguments)
