"""Several queues: in which order steps give them work side by side, what is submitted together, and who waits for whom.

    graphics   gbuffer ─────────── shadows ── lighting ── tonemap        batches: [gbuffer] [shadows] [lighting tonemap]
                      └─> occlusion ─────────┘                           [occlusion] waits for the first batch, and the
    compute                                                              last one for it: shadows need neither

Steps of one queue run in their order. Between two queues nothing is ordered but by waiting: a *crossing* is a step that
needs another queue's step to be done, of this frame or of the one before (a frame is one turn of a wheel). Batches are
cut in front of who waits and behind who is waited for, and nowhere else.

Most crossings need no wait of their own. Each queue has a vector clock: how far it knows every queue to be, by its own
waits and by what those it waited for knew (Mattern, "Virtual Time and Global States of Distributed Systems", 1989). Who
needs nothing newer than that waits for nothing. The same clocks say which transients may share memory: sharing follows
the order that there is, and never adds a wait between queues.

*Places* number the steps over frames: a frame has one for what comes before its first step, one for each step, and one
for its epilogue, and the next frame goes on from there.
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
"""What a pass can ask for. Whatever draws, and what is not said to be elsewhere, is on the first one."""


def check_word(field: Field) -> None:
    """Raise GraphError, with the place in the file, unless a field names a queue."""
    if field.word() not in QUEUES:
        raise field.wrong(f"is {brief(field.word())}, which is no queue{suggest(field.word(), QUEUES)}")


def moved(node: Node, field: Field, name: str) -> Node:
    """Return pass `name` on the queue that a file's field names; GraphError, with its place, where it draws."""
    queue = field.word()
    if queue != GRAPHICS == node.kind:
        raise field.wrong(f"is {queue!r}, and {name!r} draws: only what computes or copies can run there")
    return replace(node, queue=queue)


def queue_of(node: Node, queues: Collection[str]) -> str:
    """Return the queue on which a pass runs where there are `queues`: that which it asks for, or else graphics.

    Raises GraphError for a queue that nobody knows, and for a pass that draws and asks for another one than graphics.
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
    """Says which of the passes that are ready comes first, so that the queues have work at the same time.

    What is not graphics is submitted as soon as it can be. Of the rest, passes come first that need no wait, among
    them those that other queues' work depends on, the closer the sooner; who has to wait comes last, by the age of
    what it waits for.
    """

    def __init__(self, queues: Mapping[str, str], edges: Sequence[Edge]) -> None:
        self._queues = queues
        self._before: dict[str, set[str]] = defaultdict(set)
        for edge in edges:
            self._before[edge.after].add(edge.before)
        self._leads: dict[str, int] = {}
        """By pass from which a way leads to another queue than graphics: how many edges it has."""
        reached = [name for name, queue in queues.items() if queue != GRAPHICS]
        for edges_away in range(1, len(queues) + 1):
            reached = [
                name
                for name in {one for after in reached for one in self._before[after]}
                if name not in self._leads
            ]
            self._leads |= dict.fromkeys(reached, edges_away)
            if not reached:
                break
        self._placed: dict[str, int] = {}
        self._newest: dict[str, int] = {}
        """By pass, the number of the newest one before it on another queue; 0 if there is none."""
        self._known: dict[str, int] = dict.fromkeys(queues.values(), 0)

    def rank(self, name: str) -> tuple[bool, int, int]:
        """Return the rank of a pass whose predecessors are placed: the lowest comes first."""
        queue = self._queues[name]
        return queue == GRAPHICS, self._waits_for(name), self._leads.get(name, len(self._queues))

    def place(self, name: str) -> bool:
        """Note that a pass is placed; return whether the ranks of others on its queue may be other ones now."""
        needs = self._waits_for(name)
        self._placed[name] = len(self._placed) + 1
        queue = self._queues[name]
        self._known[queue] = max(needs, self._known[queue])
        return needs > 0

    def _waits_for(self, name: str) -> int:
        """Return the number of the newest pass of another queue that it would have to wait for; 0 if of none."""
        queue = self._queues[name]
        newest = self._newest.get(name)
        if newest is None:  # once is enough: all before it are placed
            others = (self._placed[other] for other in self._before[name] if self._queues[other] != queue)
            newest = self._newest[name] = max(others, default=0)
        return newest if newest > self._known[queue] else 0


# --- clocks -----------------------------------------------------------------------------------------------------------


class Crossing(NamedTuple):
    """The step at place `after` needs in `stages` what another queue has done up to place `before`.

    `after` may be a place of the next frame. Who needs a step of a frame yet older, and does not know it yet, waits for
    that of the frame before.
    """

    before: int
    after: int
    stages: frozenset[str]


NEVER = -(1 << 40)
"""The place of somebody who knows nothing."""

_FRAMES = 3
"""As many are looked at: in the last one everything is known that will ever be known of the two before it."""


class Clocks:
    """What each step knows of every queue, by the waits that `crossings` need; those waits, and the batches between.

    `queues` are those of the steps.
    """

    def __init__(self, queues: Sequence[str], crossings: Collection[Crossing]) -> None:
        self.frame = len(queues) + 2
        """Places of a frame."""
        self._queues = (GRAPHICS, *queues, GRAPHICS)
        self._names = sorted({*self._queues})
        self._lane = [self._names.index(queue) for queue in self._queues]
        # By place in the frame and lane, the newest place that is needed: below 0 in frames before.
        newest: dict[tuple[int, int], int] = {}
        for one in crossings:
            frame, place = divmod(one.after, self.frame)
            before = one.before - frame * self.frame
            key = place, self._lane[one.before % self.frame]
            newest[key] = max(before, newest.get(key, before))
        self._needs: dict[int, list[tuple[int, int]]] = defaultdict(list)
        for (place, lane), before in newest.items():
            self._needs[place].append((before, lane))
        self._clocks: list[tuple[int, ...]] = []
        self._gained: list[list[list[tuple[int, int, int]]]] = [
            [[] for _ in self._names] for _ in self._names
        ]
        """By lane, and lane of which it learns: (newest place known, place that waits, place waited for)."""
        self._run()
        start = self._last(0)
        self._known = np.array(self._clocks[start:]).T - start
        """(lanes, places): how far the step at a place knows each queue to be."""
        self._stages: dict[tuple[int, int], set[str]] = defaultdict(set)
        for one in crossings:
            self.serve(one.before, one.after, one.stages)

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
                    learned = tuple(map(max, known[lane], self._told(target)))
                    for of, (was, now) in enumerate(zip(known[lane], learned, strict=True)):
                        if now > was:
                            self._gained[lane][of].append((now, start + place, target))
                    known[lane] = learned
                self._clocks.append(known[lane])

    def _told(self, place: int) -> tuple[int, ...]:
        """Return what is known to who waits for the step at a place."""
        told = list(self._clocks[place])
        told[self._lane[place % self.frame]] = place
        return tuple(told)

    def _last(self, place: int) -> int:
        """Return a place, counted from a frame's start, as one of the last frame that is looked at."""
        return place + (_FRAMES - 1) * self.frame

    def knows(self, after: int, before: int) -> bool:
        """Whether waits alone order the step at `before` in front of that at `after`, be it of the same queue."""
        frame = after // self.frame * self.frame
        after, before = self._last(after - frame), self._last(before - frame)
        return self._clocks[after][self._lane[before % self.frame]] >= before

    def serve(self, before: int, after: int, stages: frozenset[str]) -> None:
        """Let the wait by which `after` knows of `before` hold these stages as well."""
        frame = after // self.frame * self.frame
        after, before = self._last(after - frame), self._last(before - frame)
        lane, of = self._lane[after % self.frame], self._lane[before % self.frame]
        gained = self._gained[lane][of]
        newest, waiting, target = gained[bisect_left(gained, (before,))]
        assert newest >= before and waiting <= after, "nobody waits for it"
        self._stages[waiting % self.frame, target - waiting // self.frame * self.frame] |= stages

    # --- memory ---

    def together(self, uses: Sequence[Mapping[str, tuple[int, int]]]) -> np.ndarray:
        """Return (uses, uses) bool: which resources may share no memory, since nothing orders them.

        `uses` says by resource and queue the places of its first and its last step in a frame. One has to be done
        before the other begins, and the other before the one begins in the next frame.
        """
        first = np.array([min(begin for begin, _ in mine.values()) for mine in uses])
        # All by lane, so that NumPy runs along rows of resources, not along two or three lanes.
        last = np.array([[mine.get(queue, (0, NEVER))[1] for mine in uses] for queue in self._names])
        now, later = self._known[:, first], self._known[:, first]
        lanes, columns = np.array(self._lane)[first], np.arange(len(uses))
        now[lanes, columns] = first - 1  # steps of one queue come one after the other
        later[lanes, columns] = -1
        # [one, other]: one is done before the other begins; the other before one begins in the next frame.
        done = (last[:, :, None] <= now[:, None]).all(0)
        again = ((last[:, None] == NEVER) | (last[:, None] - self.frame <= later[:, :, None])).all(0)
        apart = done & again
        return ~(apart | apart.T)

    # --- batches ---

    def batches(self, epilogue: bool) -> tuple[Batch, ...]:
        """Return what is submitted, in an order in which nobody waits for what comes later.

        With an `epilogue` there is a last batch of graphics that it can be part of; that and one for what comes before
        the first step may have no steps.
        """
        waits: dict[int, list[int]] = defaultdict(list)
        for waiting, target in self._stages:
            waits[waiting].append(target)
        ends = {target % self.frame for targets in waits.values() for target in targets}
        used = [*range(1, self.frame - 1)]
        used = [0] * (0 in ends) + used + [self.frame - 1] * (epilogue or self.frame - 1 in waits)
        found: list[list[int]] = []
        number: dict[int, int] = {}  # of the batch, by place
        now: dict[int, int] = {}  # that which is still open, by lane
        for place in used:
            lane = self._lane[place]
            if lane not in now or place in waits:
                now[lane] = len(found)
                found.append([])
            found[now[lane]].append(place)
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
            for places in found
        ) or (Batch(GRAPHICS, ()),)
