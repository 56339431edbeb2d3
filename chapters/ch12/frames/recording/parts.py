"""Lists of draws that are cut into parts: a pass fills a list, and several threads each record a part of it.

    draws = DrawList(multi_draw=True)
    forward.record(draws)  # stores groups with their bindings, records nothing
    for first, last in split(draws.calls, part_count(draws.calls, least=256)):
        draws.record(commands_of(first), first, last)  # by any thread, into commands of its own

The unit is the draw call, since the cost of recording is its calls. With indirect draws a group of a thousand objects
is one call; without them it is a thousand calls, and may be cut in the middle. Each part binds all that its calls need.
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
    """Return the index of the pool of a frame slot and a thread; ValueError if there is none."""
    if not 0 <= thread < threads or frame < 0:
        raise ValueError(f"frame {frame} and thread {thread} of {threads} have no pool")
    return frame * threads + thread


def part_count(calls: int, least: int) -> int:
    """Return the number of parts of `least` calls or more that `calls` are cut into; 0 if fewer than two."""
    parts = calls // least
    return parts if parts > 1 else 0


class Groups:
    """Groups of draws whose calls are numbered from `first` on."""

    def __init__(self, groups: Sequence[DrawGroup], multi_draw: bool, first: int = 0) -> None:
        self._groups, self._first = groups, first
        calls = (1 if multi_draw else group.batch.count for group in groups)
        self._ends = list(accumulate(calls, initial=first))[1:]
        self.end = self._ends[-1] if self._ends else first
        """The number after that of the last call."""

    def part(self, first: int, last: int) -> list[DrawGroup]:
        """Return the groups of calls [first, last), at least one call; the groups at its ends may be cut."""
        low, high = bisect_right(self._ends, first), bisect_left(self._ends, last)
        numbered_groups = list(self._groups[low : high + 1])
        if last < self._ends[high]:  # the tail first: a cut there keeps the number of the group's first draw
            numbered_groups[-1] = _cut(
                numbered_groups[-1], 0, numbered_groups[-1].batch.count - (self._ends[high] - last)
            )
        start = self._ends[low - 1] if low else self._first
        if first > start:
            numbered_groups[0] = _cut(numbered_groups[0], first - start, numbered_groups[0].batch.count)
        return numbered_groups


def _cut(group: DrawGroup, begin: int, end: int) -> DrawGroup:
    """Return draws [begin, end) of a group. Only the piece with the first draw counts the triangles of the group."""
    batch = group.batch
    triangles = batch.triangles if begin == 0 else 0
    return replace(
        group, batch=replace(batch, first=batch.first + begin, count=end - begin, triangles=triangles)
    )


class DrawList:
    """Stores draws, to be recorded later in parts; it has the draw methods of a backend's `Commands`."""

    def __init__(self, multi_draw: bool) -> None:
        self._multi_draw = multi_draw
        self._steps: list[tuple[int, int, Callable[[Commands, int, int], None]]] = []
        self.calls = 0
        """The number of draw calls."""

    def draw_fullscreen(self, pipeline: Built, scene: SceneBinding | None, sources: Any) -> None:
        """Store a full-screen triangle with its bindings, as one call."""

        def record(commands: Commands, first: int, last: int) -> None:
            commands.sources = sources
            commands.draw_fullscreen(pipeline, scene)

        self._add(self.calls + 1, record)

    def draw_groups(self, groups: Sequence[DrawGroup], scene: SceneBinding) -> None:
        """Store groups of draws, with the data of the scene that they bind."""
        numbered_groups = Groups(groups, self._multi_draw, self.calls)

        def record(commands: Commands, first: int, last: int) -> None:
            commands.draw_groups(numbered_groups.part(first, last), scene)

        self._add(numbered_groups.end, record)

    def draw_by(self, record: Callable[[Any], None]) -> None:
        """Store other draws, as one call."""
        self._add(self.calls + 1, lambda commands, first, last: record(commands))

    def _add(self, end: int, record: Callable[[Commands, int, int], None]) -> None:
        self._steps.append((self.calls, end, record))
        self.calls = end

    def record(self, commands: Commands, first: int, last: int) -> None:
        """Record calls [first, last) in order, with all that they bind, into the backend's `commands`."""
        for start, end, record in self._steps:
            begin, stop = max(first, start), min(last, end)
            if begin < stop:
                record(commands, begin, stop)
