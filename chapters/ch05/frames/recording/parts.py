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
from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import accumulate
from typing import Any

from ...pipelines.description import Built
from ..commands import Commands, DrawGroup, SceneBinding


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
    """Groups of draws whose calls are numbered from `first` on."""

    def __init__(self, groups: Sequence[DrawGroup], multi_draw: bool, first: int = 0) -> None:
        self._groups, self._first = groups, first
        calls = (1 if multi_draw else group.batch.count for group in groups)
        self._ends = list(accumulate(calls, initial=first))[1:]
        self.end = self._ends[-1] if self._ends else first
        """The number behind that of the last call."""

    def part(self, first: int, last: int) -> list[DrawGroup]:
        """Return the groups of calls [first, last), of which there is one at least; those at its ends may be cut."""
        low, high = bisect_right(self._ends, first), bisect_left(self._ends, last)
        found = list(self._groups[low : high + 1])
        if last < self._ends[high]:  # the tail first: cut groups keep the number of their first draw
            found[-1] = _cut(found[-1], 0, found[-1].batch.count - (self._ends[high] - last))
        start = self._ends[low - 1] if low else self._first
        if first > start:
            found[0] = _cut(found[0], first - start, found[0].batch.count)
        return found


def _cut(group: DrawGroup, begin: int, end: int) -> DrawGroup:
    """Return draws [begin, end) of a group. Its triangles count where its first draw is: their sum stays right."""
    batch = group.batch
    triangles = batch.triangles if begin == 0 else 0
    return replace(
        group, batch=replace(batch, first=batch.first + begin, count=end - begin, triangles=triangles)
    )


class DrawList:
    """Has the methods of a backend's `Commands` with which passes draw, and writes down what they are asked for."""

    def __init__(self, multi_draw: bool) -> None:
        self._multi_draw = multi_draw
        self._steps: list[tuple[int, int, Callable[[Commands, int, int], None]]] = []
        self.calls = 0
        """How many calls draw."""

    def draw_fullscreen(self, pipeline: Built, scene: SceneBinding | None, sources: Any) -> None:
        """Write down a triangle with all that is bound for it: no part begins between them."""

        def record(commands: Commands, first: int, last: int) -> None:
            commands.sources = sources
            commands.draw_fullscreen(pipeline, scene)

        self._add(self.calls + 1, record)

    def draw_groups(self, groups: Sequence[DrawGroup], scene: SceneBinding) -> None:
        """Write down groups of draws, and what they are drawn with."""
        found = Groups(groups, self._multi_draw, self.calls)

        def record(commands: Commands, first: int, last: int) -> None:
            commands.draw_groups(found.part(first, last), scene)

        self._add(found.end, record)

    def _add(self, end: int, record: Callable[[Commands, int, int], None]) -> None:
        self._steps.append((self.calls, end, record))
        self.calls = end

    def record(self, commands: Commands, first: int, last: int) -> None:
        """Record calls [first, last), in their order, and all that they need, into the backend's `commands`."""
        for start, end, record in self._steps:
            begin, stop = max(first, start), min(last, end)
            if begin < stop:
                record(commands, begin, stop)
