"""Several queues: the order of steps for overlap, the batches to submit, and the waits between queues.

    graphics   gbuffer ─────────── shadows ── lighting ── tonemap        batches: [gbuffer] [shadows] [lighting tonemap]
                      └─> occlusion ─────────┘                           [occlusion] waits for [gbuffer], the last batch
    compute                                                              for [occlusion]; [shadows] waits for none

Steps of one queue run in order. Only waits order two queues. A *crossing* is the dependency of a step on a step of
another queue, in this frame or the previous frame. A new batch begins before each step that waits, and after each step
that another queue waits for.

Most crossings need no separate wait. Each queue has a vector clock: for every queue, the last step that is known to be
done. A wait adds the clock of the queue that it waits for (Mattern, "Virtual Time and Global States of Distributed
Systems", 1989). A step that needs nothing newer does not wait. The same clocks decide which transients may share
memory: sharing follows the existing order, and never adds a wait between queues.

*Places* number the steps over several frames: a frame has one place before its first step, one for each step, and one
for its epilogue; then the next frame follows.
"""

from __future__ import annotations

from bisect import bisect_left
from collections import defaultdict
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from common.names import suggest

from ..fields import Field
from ..json_places import brief
from ..types import Edge, GraphError, Node
from .batches import Batch, Wait

GRAPHICS = "graphics"
QUEUES = (GRAPHICS, "compute")
"""The queues for passes. The first one is the default, and the only one for passes that draw."""


def check_word(field: Field) -> None:
    """Raise GraphError with the place in the file unless the field names a queue."""
    if field.word() not in QUEUES:
        raise field.wrong(f"is {brief(field.word())}, which is no queue{suggest(field.word(), QUEUES)}")


def moved(node: Node, field: Field, name: str) -> Node:
    """Return the node with the queue of a field; raise GraphError with the field's place if the pass draws."""
    queue = field.word()
    if queue != GRAPHICS == node.kind:
        raise field.wrong(f"is {queue!r}, and {name!r} draws: only what computes or copies can run there")
    return replace(node, queue=queue)


def queue_of(node: Node, queues: Collection[str]) -> str:
    """Return the queue on which a pass runs: its own if that is one of `queues`, else graphics.

    Raises GraphError for an unknown queue, and for a pass that draws on another queue than graphics.
    """
    if node.queue not in QUEUES:
        near = suggest(str(node.queue), QUEUES)
        end = "" if near.endswith("?") else ": there are graphics and compute."
        raise GraphError(f"'{node.name}' asks for the queue {node.queue!r}, which is none{near}{end}")
    if node.kind == "graphics" and node.queue != GRAPHICS:
        raise GraphError(
            f"'{node.name}' draws, and asks for the queue '{node.queue}': only what computes or copies can run there."
        )
    return node.queue if node.queue in queues else GRAPHICS


# --- order ------------------------------------------------------------------------------------------------------------


class Eager:
    """The priority of ready passes, so that the queues have work at the same time.

    Passes of other queues than graphics come as soon as possible. Of the graphics passes, those without a wait come
    first, ordered by their distance to work of another queue that depends on them. Passes with a wait come last, in
    the order of the work that they wait for.
    """

    def __init__(self, queues: Mapping[str, str], edges: Sequence[Edge]) -> None:
        self._queues = queues
        self._before: dict[str, set[str]] = defaultdict(set)
        for edge in edges:
            self._before[edge.after].add(edge.before)
        self._leads: dict[str, int] = {}
        """For each pass with a path to another queue: the number of edges of the path."""
        reached = [name for name, queue in queues.items() if queue != GRAPHICS]
        for edges_away in range(1, len(queues) + 1):
            reached = [
                name
                for name in {before for after in reached for before in self._before[after]}
                if name not in self._leads
            ]
            self._leads |= dict.fromkeys(reached, edges_away)
            if not reached:
                break
        self._placed: dict[str, int] = {}
        self._newest: dict[str, int] = {}
        """For each pass, the number of the newest predecessor on another queue; 0 if there is none."""
        self._known: dict[str, int] = dict.fromkeys(queues.values(), 0)

    def rank(self, name: str) -> tuple[bool, int, int]:
        """Return the rank of a pass whose predecessors are placed; the lowest rank comes first."""
        queue = self._queues[name]
        return queue == GRAPHICS, self._waits_for(name), self._leads.get(name, len(self._queues))

    def place(self, name: str) -> bool:
        """Note that a pass is placed; return whether ranks of other passes on its queue may have changed."""
        needs = self._waits_for(name)
        self._placed[name] = len(self._placed) + 1
        queue = self._queues[name]
        self._known[queue] = max(needs, self._known[queue])
        return needs > 0

    def _waits_for(self, name: str) -> int:
        """Return the number of the newest pass of another queue that a pass waits for; 0 if there is none."""
        queue = self._queues[name]
        newest = self._newest.get(name)
        if newest is None:  # computed once: all predecessors are placed
            placed = (self._placed[other] for other in self._before[name] if self._queues[other] != queue)
            newest = self._newest[name] = max(placed, default=0)
        return newest if newest > self._known[queue] else 0


# --- clocks -----------------------------------------------------------------------------------------------------------


class Crossing(NamedTuple):
    """The step at place `after` depends, at `stages`, on the work of another queue up to place `before`.

    `after` may be a place of the next frame. A dependency on an older frame becomes a wait for the same step of the
    previous frame, unless other waits imply it.
    """

    before: int
    after: int
    stages: frozenset[str]


NEVER = -(1 << 40)
"""The place before all known ones."""

_FRAMES = 3
"""The number of simulated frames: the clocks of the last one are final for the two frames before it."""


class Clocks:
    """The vector clock of each step, the waits that `crossings` need, and the batches between waits.

    `queues` has the queue of each step.
    """

    def __init__(self, queues: Sequence[str], crossings: Collection[Crossing]) -> None:
        self.frame = len(queues) + 2
        """The number of places of a frame."""
        self._queues = (GRAPHICS, *queues, GRAPHICS)
        self._names = sorted({*self._queues})
        self._lane = [self._names.index(queue) for queue in self._queues]
        # By place in the frame and lane: the newest needed place, below 0 in earlier frames.
        newest: dict[tuple[int, int], int] = {}
        for crossing in crossings:
            frame, place = divmod(crossing.after, self.frame)
            before = crossing.before - frame * self.frame
            key = place, self._lane[crossing.before % self.frame]
            newest[key] = max(before, newest.get(key, before))
        self._needs: dict[int, list[tuple[int, int]]] = defaultdict(list)
        for (place, lane), before in newest.items():
            self._needs[place].append((before, lane))
        self._clocks: list[tuple[int, ...]] = []
        self._gained: list[list[list[tuple[int, int, int]]]] = [
            [[] for _ in self._names] for _ in self._names
        ]
        """By (waiting lane, other lane): (newest known place, waiting place, place waited for)."""
        self._run()
        start = self._last(0)
        self._known = np.array(self._clocks[start:]).T - start
        """(lanes, places): the vector clock of the step at each place."""
        self._stages: dict[tuple[int, int], set[str]] = defaultdict(set)
        for crossing in crossings:
            self.extend(crossing.before, crossing.after, crossing.stages)

    def _run(self) -> None:
        known = [(NEVER,) * len(self._names) for _ in self._names]
        for frame in range(_FRAMES):
            start = frame * self.frame
            for place, lane in enumerate(self._lane):
                for before, other in sorted(self._needs.get(place, ()), reverse=True):
                    target = start + before
                    if target < 0 or known[lane][other] >= target:
                        continue
                    target = max(target, start - self.frame + target % self.frame)
                    learned = tuple(map(max, known[lane], self._clock_after(target)))
                    for of, (was, now) in enumerate(zip(known[lane], learned, strict=True)):
                        if now > was:
                            self._gained[lane][of].append((now, start + place, target))
                    known[lane] = learned
                self._clocks.append(known[lane])

    def _clock_after(self, place: int) -> tuple[int, ...]:
        """Return the clock that a wait for the step at a place adds."""
        clock = list(self._clocks[place])
        clock[self._lane[place % self.frame]] = place
        return tuple(clock)

    def _last(self, place: int) -> int:
        """Return a place, counted from the start of a frame, as a place of the last simulated frame."""
        return place + (_FRAMES - 1) * self.frame

    def orders(self, after: int, before: int) -> bool:
        """Whether waits alone order the step at `before` before the step at `after`; both may be on one queue."""
        frame = after // self.frame * self.frame
        after, before = self._last(after - frame), self._last(before - frame)
        return self._clocks[after][self._lane[before % self.frame]] >= before

    def extend(self, before: int, after: int, stages: frozenset[str]) -> None:
        """Add stages to the wait that orders `before` before `after`."""
        frame = after // self.frame * self.frame
        after, before = self._last(after - frame), self._last(before - frame)
        lane, of = self._lane[after % self.frame], self._lane[before % self.frame]
        gained = self._gained[lane][of]
        newest, waiting, target = gained[bisect_left(gained, (before,))]
        assert newest >= before and waiting <= after, "no batch waits for it"
        self._stages[waiting % self.frame, target - waiting // self.frame * self.frame] |= stages

    # --- memory ---

    def together(self, uses: Sequence[Mapping[str, tuple[int, int]]]) -> np.ndarray:
        """Return (uses, uses) bool: the pairs of resources that may not share memory, since nothing orders their uses.

        `uses` has, by resource and queue, the places of the first and the last step in a frame. Resources a and b may
        share memory if all uses of a precede all uses of b, and these precede the uses of a in the next frame.
        """
        first = np.array([min(begin for begin, _ in places.values()) for places in uses])
        # Arrays by lane, so that NumPy loops over resources, not over two or three lanes.
        last = np.array([[places.get(queue, (0, NEVER))[1] for places in uses] for queue in self._names])
        now, later = self._known[:, first], self._known[:, first]
        lanes, columns = np.array(self._lane)[first], np.arange(len(uses))
        now[lanes, columns] = first - 1  # steps of one queue are in order
        later[lanes, columns] = -1
        # [a, b]: a ends before b begins; b ends before a begins in the next frame.
        done = (last[:, :, None] <= now[:, None]).all(0)
        again = ((last[:, None] == NEVER) | (last[:, None] - self.frame <= later[:, :, None])).all(0)
        apart = done & again
        return ~(apart | apart.T)

    # --- batches ---

    def batches(self, epilogue: bool) -> tuple[Batch, ...]:
        """Return the batches in an order in which none waits for a later one.

        With an `epilogue` the last batch is on graphics and contains it. This batch may have no steps, as may a batch
        before the first step.
        """
        waits: dict[int, list[int]] = defaultdict(list)
        for waiting, target in self._stages:
            waits[waiting].append(target)
        ends = {target % self.frame for targets in waits.values() for target in targets}
        used = [*range(1, self.frame - 1)]
        used = [0] * (0 in ends) + used + [self.frame - 1] * (epilogue or self.frame - 1 in waits)
        batches: list[list[int]] = []
        number: dict[int, int] = {}  # the batch of each place
        now: dict[int, int] = {}  # the open batch, by lane
        for place in used:
            lane = self._lane[place]
            if lane not in now or place in waits:
                now[lane] = len(batches)
                batches.append([])
            batches[now[lane]].append(place)
            number[place] = now[lane]
            if place in ends:
                del now[lane]
        return tuple(
            Batch(
                self._queues[places[0]],
                tuple(place - 1 for place in places if 0 < place < self.frame - 1),
                tuple(
                    Wait(number[target % self.frame], target < 0, frozenset(self._stages[places[0], target]))
                    for target in sorted(waits.get(places[0], ()), reverse=True)
                ),
            )
            for places in batches
        ) or (Batch(GRAPHICS, ()),)
