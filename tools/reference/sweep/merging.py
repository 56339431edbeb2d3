"""References while they are traced: parts are handed out, and merged in the order of their paths and tiles.

Blocks are merged once all tiles have them. What stops a reference is decided by its merged paths alone, as
`tracing.trace` does it: parts that were handed out ahead and lie beyond are dropped. So neither the number of workers
nor the order in which they finish changes a bit.
"""

from __future__ import annotations

import math
import time as clock
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property

from common.errors import StrataError
from tools.reference.command import Request
from tools.reference.contents import file_name
from tools.reference.sums import Sums
from tools.reference.sweep.pools import Pool
from tools.reference.sweep.work import MOST_WAITING, Blocks, Key, Part, counts_of
from tools.reference.tiles import Tile, merged, tiles_of
from tools.reference.tracing import KEEP_EVERY_S, Keeper, cached_path, judged, spoken_time


@dataclass(frozen=True)
class Finished:
    """A reference that is traced: its sums, its estimated error, and the seconds that this run traced it."""

    sums: Sums
    error: float
    seconds: float


@dataclass
class Reference:
    """A reference of a sweep. `scale` is the factor from nits to the picture's values."""

    number: int
    name: str
    request: Request
    facts: dict[str, str]
    scale: float
    cached: bool = True
    keeper: Keeper | None = None
    """Its sums, from its first part to its end."""
    problem: StrataError | None = None
    done: bool = False
    flying: set[Key] = field(default_factory=set)
    part_of_whole: float = 0.0
    _ahead: dict[int, dict[int, Blocks]] = field(default_factory=dict)
    """By the number of the first path and that of the tile."""
    _next: int = 0
    _next_tile: int = 0
    _needed: float = math.inf
    """About how many paths suffice."""
    _seconds: float = 0.0
    _next_keep: float = 0.0

    @cached_property
    def tiles(self) -> tuple[Tile, ...]:
        """The tiles of the picture."""
        return tiles_of(self.request.size)

    @cached_property
    def content(self) -> str:
        """A name that references of equal facts share."""
        return file_name(self.facts)

    def begin(self) -> None:
        """Read what is traced already."""
        path = cached_path(self.facts) if self.cached else None
        self.keeper = Keeper(path, self.facts, self.request.size)
        self._next = self.keeper.sums.paths
        self._next_keep = clock.perf_counter() + KEEP_EVERY_S
        self._judge()
        self._follow()

    def next_part(self) -> Part | None:
        """Return the next part to be traced, or None: paths that are handed out reach the limit, or too many wait.

        The same paths of all tiles come before further ones.
        """
        assert self.keeper is not None
        counts = self._counts(self._next)
        if self.done or not counts:
            return None
        if self._next > self.keeper.sums.paths and self._waiting_bytes() > MOST_WAITING:
            return None  # until the part comes for which they wait
        facts = tuple(self.facts.items())
        part = Part(self.request, facts, self.number, self._next, counts, self.tiles[self._next_tile])
        self._next_tile = (self._next_tile + 1) % len(self.tiles)
        if self._next_tile == 0:
            self._next = part.end
        self.flying.add(part.key)
        return part

    def take(self, part: Part, blocks: Blocks) -> None:
        """Merge a part, and those behind it that came earlier, as far as no part before is missing."""
        assert self.keeper is not None
        self.flying.discard(part.key)
        self._ahead.setdefault(part.first, {})[part.tile.number] = blocks
        while len(self._ahead.get(first := self.keeper.sums.paths, ())) == len(self.tiles):
            found = [blocks for _, blocks in sorted(self._ahead.pop(first).items())]
            self._seconds += sum(one.seconds for one in found)
            devices = [one.device for one in found]
            for number, count in enumerate(self._counts(first)):
                block = merged(self.tiles, self.request.size, (one.sums[number] for one in found))
                self.keeper.sums = self.keeper.sums.plus(*block, count, *devices)
                if self._judge():
                    return
        self._follow()
        self._keep_sometimes()

    def end(self) -> Finished:
        """Keep the sums, and return them."""
        assert self.keeper is not None
        self.keeper.keep()
        sums = self.keeper.sums
        self._ahead.clear()
        error = sums.error(self.scale) if sums.paths else 1.0
        return Finished(sums, error, self._seconds)

    def _counts(self, first: int) -> tuple[int, ...]:
        """Return the blocks of the parts that begin after `first` paths."""
        return counts_of(first, self.request.size, self.request.paths)

    def _waiting_bytes(self) -> int:
        parts = (one for found in self._ahead.values() for one in found.values())
        return sum(light.nbytes + squares.nbytes for one in parts for light, squares in one.sums)

    def _judge(self) -> bool:
        """Find out whether the merged paths suffice, and return it."""
        assert self.keeper is not None
        sums, request = self.keeper.sums, self.request
        found = judged(sums, self.scale)
        if found <= request.error or not self._counts(sums.paths):
            self.done, self.part_of_whole = True, 1.0
        elif request.error == 0.0:
            self._needed = request.paths
        elif math.isfinite(found):
            self._needed = min(sums.paths * (found / request.error) ** 2, request.paths)
        return self.done

    def _follow(self) -> None:
        """Find out which part of the whole is behind, tiles that wait for others included."""
        assert self.keeper is not None
        if not self.done:
            waiting = sum(len(found) * sum(self._counts(first)) for first, found in self._ahead.items())
            paths = self.keeper.sums.paths + waiting / len(self.tiles)
            self.part_of_whole = min(paths / self._needed, 1.0)

    def _keep_sometimes(self) -> None:
        assert self.keeper is not None
        now = clock.perf_counter()
        if now >= self._next_keep and not self.done:
            self.keeper.keep()
            taken = clock.perf_counter() - now
            self._next_keep = now + max(KEEP_EVERY_S, 10.0 * taken)


Ended = Callable[[Reference, Finished], None]
Progress = Callable[[float, str], object]


class Merging:
    """Hands out parts of references, and merges what comes back.

    `ended` is called for each reference whose paths suffice; what it raises counts as the problem of that reference.
    References of equal facts are traced one after the other, since the later one goes on with the sums of the earlier.
    """

    def __init__(self, references: Sequence[Reference], pool: Pool, ended: Ended, progress: Progress) -> None:
        self._references, self._pool, self._ended, self._progress = references, pool, ended, progress
        self._waiting = list(references)
        self._parts = 0
        self._began: float | None = None
        self._part_at_begin = 0.0

    def run(self) -> None:
        """Trace all references; those that have a `problem` at the end were given up, with their sums kept."""
        while self._waiting:
            self._hand_out()
            if not any(reference.flying for reference in self._waiting):
                continue
            for part, outcome in self._pool.outcomes():
                reference = self._references[part.reference]
                if part.key not in reference.flying:
                    continue
                if isinstance(outcome, StrataError):
                    self._give_up(reference, outcome)
                    continue
                if isinstance(outcome, Exception):
                    raise outcome
                reference.take(part, outcome)
                self._parts += 1
                if reference.done:
                    self._end(reference)
            self._tell()

    def _hand_out(self) -> None:
        """Give the pool as many parts as it can trace, and some that wait for their turn."""
        wanted = 2 * self._pool.workers
        ready = self._ready(wanted)
        share = max(1, math.ceil(wanted / max(len(ready), 1)))
        flying = sum(len(reference.flying) for reference in self._waiting)
        for reference in ready:
            if reference.keeper is None and flying < wanted:
                reference.begin()
            if reference.done:
                self._end(reference)
                continue
            while flying < wanted and len(reference.flying) < share:
                part = reference.next_part()
                if part is None:
                    break
                self._pool.submit(part)
                flying += 1

    def _ready(self, most: int) -> list[Reference]:
        """Return the first references that wait, less those of equal facts behind another one."""
        seen: set[str] = set()
        ready: list[Reference] = []
        for reference in self._waiting:
            if len(ready) == most:
                break
            if reference.content not in seen:
                seen.add(reference.content)
                ready.append(reference)
        return ready

    def _end(self, reference: Reference) -> None:
        self._drop(reference)
        try:
            self._ended(reference, reference.end())
        except StrataError as problem:
            reference.problem = problem
        reference.keeper = None

    def _give_up(self, reference: Reference, problem: StrataError) -> None:
        reference.problem = problem
        self._drop(reference)
        reference.end()
        reference.part_of_whole = 1.0

    def _drop(self, reference: Reference) -> None:
        self._pool.drop(reference.flying)
        reference.flying.clear()
        self._waiting.remove(reference)

    def _tell(self) -> None:
        """Say how far the sweep is and how long the rest takes, without the first part, in which drivers compile."""
        behind = sum(reference.part_of_whole for reference in self._references) / len(self._references)
        ended = len(self._references) - len(self._waiting)
        text = f"{ended} of {len(self._references)} references, {self._parts} parts"
        if self._began is None and self._parts:
            self._began, self._part_at_begin = clock.perf_counter(), behind
        elif self._began is not None and behind > self._part_at_begin:
            since = clock.perf_counter() - self._began
            left = since * (1.0 - behind) / (behind - self._part_at_begin)
            text += f", about {spoken_time(left)} left"
        self._progress(behind, text)
