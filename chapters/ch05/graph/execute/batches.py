"""The batches of a compiled graph while frames are drawn: what each waits for, and which can be left out.

A batch that has nothing to do is not submitted, and nobody who comes behind it must miss what went through it:
`can_rest` says of which batches that is so, and `Reached` keeps the books of what is waited for.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from ..sync.batches import Batch
from ..sync.queues import GRAPHICS, QUEUES
from ..types import PREVIOUS, Barrier, Graph

Waited = tuple[str, int, frozenset[str]]
"""A queue, the value of its timeline that is waited for, and the stages that wait."""

EVERYTHING = frozenset({"everything"})
"""All stages, whichever they are."""


def batches_of(graph: Graph) -> tuple[Batch, ...]:
    """Return the batches of a frame, one of which at least is for graphics: a frame without passes is one, too."""
    steps = () if graph.batches else tuple(range(len(graph.steps)))
    drawn = any(batch.queue == GRAPHICS for batch in graph.batches)
    return graph.batches if drawn else (*graph.batches, Batch(GRAPHICS, steps))


def last_drawn(batches: Sequence[Batch]) -> int:
    """Return the number of the batch that ends with the graph's epilogue: the last one of graphics."""
    return max(number for number, batch in enumerate(batches) if batch.queue == GRAPHICS)


def prologues(graph: Graph) -> list[tuple[str, bool, list[Barrier]]]:
    """Return (queue, whether they hand something over, barriers) of what happens before the first frame, in order.

    There a barrier from a queue to itself says on which one it happens; one to another queue is a release, which the
    first frame acquires.
    """
    found: dict[tuple[bool, str], list[Barrier]] = {}
    for barrier in graph.prologue:
        giving, taking = barrier.hand_over or (GRAPHICS, GRAPHICS)
        found.setdefault((giving != taking, giving), []).append(barrier)
    return [(queue, released, found[released, queue]) for released, queue in sorted(found)]


def can_rest(graph: Graph, batch: Batch) -> bool:
    """Whether a frame may leave out a batch of passes that say that they are idle.

    Not one that touches an image: others count on the layout in which it leaves it. Nor one that writes for others
    what shares its memory: that is lost between frames, while of everything else the content is there already, which
    is what a pass promises that is idle.
    """
    mine = [graph.steps[place] for place in batch.steps]
    touched = {_plain(name) for step in mine for name in (*step.reads, *step.writes)}
    written = {name for step in mine for name in step.writes}
    passing = {name for name in written if graph.resources[name].life == "transient"}
    elsewhere = [step for step in graph.steps if step not in mine]
    used = {_plain(name) for step in elsewhere for name in (*step.reads, *step.writes)}
    buffers = all(graph.resources[name].kind == "buffer" for name in touched)
    return batch.queue != GRAPHICS and buffers and passing.isdisjoint(used)


def _plain(name: str) -> str:
    return name.removesuffix(PREVIOUS)


class Reached:
    """Which values the batches of two frames stand for, and which of them each queue has waited for already.

    Frame by frame, in the order of submission, each batch asks for its waits, and is then said to be submitted, with
    the value that it signals, or to rest. One that rests stands for its queue's last value and for its own waits: who
    would wait for it has these to wait for, since the graph counts on all that it orders, and so has the queue's next
    batch.
    """

    def __init__(self) -> None:
        self._last = dict.fromkeys(QUEUES, 0)
        self._owed: dict[str, dict[str, int]] = {queue: {} for queue in QUEUES}
        self._known: dict[tuple[str, str], tuple[int, frozenset[str]]] = {}
        self._before: list[dict[str, int]] = []
        self._now: list[dict[str, int]] = []

    @property
    def values(self) -> list[int]:
        """The last value of each queue, in the order of `QUEUES`."""
        return list(self._last.values())

    def follow(self) -> None:
        """Forget the frame before: another graph begins, and all that was has ended."""
        self._now = []

    def begin_frame(self) -> None:
        """Begin a frame."""
        self._before, self._now = self._now, []

    def waits(self, batch: Batch) -> list[Waited]:
        """Return what a batch has to wait for: nothing for 0, which is the first frame's, and nothing twice."""
        found: list[Waited] = []
        for wait in batch.waits:
            frame = self._before if wait.before else self._now
            values = frame[wait.batch] if frame else {}
            found += [(queue, value, wait.stages) for queue, value in values.items()]
        found += [(queue, value, EVERYTHING) for queue, value in self._owed[batch.queue].items()]
        return [one for one in found if self._is_news(batch.queue, *one)]

    def _is_news(self, by: str, queue: str, value: int, stages: frozenset[str]) -> bool:
        known, seen = self._known.get((by, queue), (0, EVERYTHING))
        return value > known or not (stages <= seen or seen >= EVERYTHING)

    def submitted(self, batch: Batch, waits: Iterable[Waited], value: int) -> None:
        """Note that a batch was submitted, with its waits and the value that it signals."""
        for queue, reached, stages in waits:
            known, seen = self._known.get((batch.queue, queue), (0, EVERYTHING))
            if reached >= known:
                self._known[batch.queue, queue] = reached, (stages | seen if reached == known else stages)
        self._owed[batch.queue] = {}
        self._last[batch.queue] = value
        self._now.append({batch.queue: value})

    def rests(self, batch: Batch, waits: Iterable[Waited]) -> None:
        """Note that a batch was left out, which had these waits."""
        values = {batch.queue: self._last[batch.queue]}
        for queue, value, _ in waits:
            values[queue] = max(value, values.get(queue, 0))
        self._owed[batch.queue] = values
        self._now.append(values)
