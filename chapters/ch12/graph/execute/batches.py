"""The batches of a compiled graph while frames are drawn: their waits, and which batches a frame leaves out.

A batch without work is not submitted. Later batches must not lose the order that it provided. `can_rest` returns
whether a batch may be left out, and `Reached` tracks the timeline values that each queue has waited for.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from ..sync.batches import Batch
from ..sync.queues import GRAPHICS, QUEUES
from ..types import PREVIOUS, Barrier, Graph

Waited = tuple[str, int, frozenset[str]]
"""A queue, the awaited value of its timeline, and the stages that wait."""

EVERYTHING = frozenset({"everything"})
"""All stages."""


def batches_of(graph: Graph) -> tuple[Batch, ...]:
    """Return the batches of a frame; at least one is for graphics, even in a frame without passes."""
    steps = () if graph.batches else tuple(range(len(graph.steps)))
    drawn = any(batch.queue == GRAPHICS for batch in graph.batches)
    return graph.batches if drawn else (*graph.batches, Batch(GRAPHICS, steps))


def last_drawn(batches: Sequence[Batch]) -> int:
    """Return the number of the batch with the graph's epilogue: the last one on graphics."""
    return max(number for number, batch in enumerate(batches) if batch.queue == GRAPHICS)


def prologues(graph: Graph) -> list[tuple[str, bool, list[Barrier]]]:
    """Return (queue, whether they are releases, barriers) of the work before the first frame, in order.

    In a prologue a `hand_over` from a queue to itself names the queue that runs the barrier. A `hand_over` to another
    queue is a release, and the first frame acquires the image.
    """
    grouped: dict[tuple[bool, str], list[Barrier]] = {}
    for barrier in graph.prologue:
        giving, taking = barrier.hand_over or (GRAPHICS, GRAPHICS)
        grouped.setdefault((giving != taking, giving), []).append(barrier)
    return [(queue, released, grouped[released, queue]) for released, queue in sorted(grouped)]


def can_rest(graph: Graph, batch: Batch) -> bool:
    """Whether a frame may leave out a batch if all of its passes are resting.

    A batch that touches an image may not be left out: later steps need the layout that it leaves. Neither may a batch
    that writes a buffer with shared memory: its contents are lost between frames. All other results of a resting pass
    are still valid from earlier frames.
    """
    steps = [graph.steps[place] for place in batch.steps]
    touched = {_plain(name) for step in steps for name in (*step.reads, *step.writes)}
    written = {name for step in steps for name in step.writes}
    transients = {name for name in written if graph.resources[name].life == "transient"}
    other_steps = [step for step in graph.steps if step not in steps]
    used = {_plain(name) for step in other_steps for name in (*step.reads, *step.writes)}
    buffers = all(graph.resources[name].kind == "buffer" for name in touched)
    return batch.queue != GRAPHICS and buffers and transients.isdisjoint(used)


def _plain(name: str) -> str:
    return name.removesuffix(PREVIOUS)


class Reached:
    """The timeline values of the batches of two frames, and the values that each queue has waited for.

    In each frame, in the order of submission, `waits` returns the waits of a batch; then `submitted` or `rests` is
    called. A resting batch stands for the last value of its queue and for its own waits. A batch that would wait for it
    inherits these waits, because the graph relies on the order; so does the next batch of the queue.
    """

    def __init__(self) -> None:
        self._last = dict.fromkeys(QUEUES, 0)
        self._owed: dict[str, dict[str, int]] = {queue: {} for queue in QUEUES}
        self._known: dict[tuple[str, str], tuple[int, frozenset[str]]] = {}
        self._before: list[dict[str, int]] = []
        self._now: list[dict[str, int]] = []

    @property
    def values(self) -> list[int]:
        """The last signalled value of each queue, in the order of `QUEUES`."""
        return list(self._last.values())

    def follow(self) -> None:
        """Forget the previous frame: another graph begins, and all earlier work is done."""
        self._now = []

    def begin_frame(self) -> None:
        """Begin a frame."""
        self._before, self._now = self._now, []

    def waits(self, batch: Batch) -> list[Waited]:
        """Return the waits of a batch, without values of 0 and values that its queue has already waited for."""
        waited: list[Waited] = []
        for wait in batch.waits:
            frame = self._before if wait.before else self._now
            values = frame[wait.batch] if frame else {}
            waited += [(queue, value, wait.stages) for queue, value in values.items()]
        waited += [(queue, value, EVERYTHING) for queue, value in self._owed[batch.queue].items()]
        return [wait for wait in waited if self._is_new(batch.queue, *wait)]

    def _is_new(self, by: str, queue: str, value: int, stages: frozenset[str]) -> bool:
        known, seen = self._known.get((by, queue), (0, EVERYTHING))
        return value > known or not (stages <= seen or seen >= EVERYTHING)

    def submitted(self, batch: Batch, waits: Iterable[Waited], value: int) -> None:
        """Note that a batch was submitted with these waits and signals `value`."""
        for queue, reached, stages in waits:
            known, seen = self._known.get((batch.queue, queue), (0, EVERYTHING))
            if reached >= known:
                self._known[batch.queue, queue] = reached, (stages | seen if reached == known else stages)
        self._owed[batch.queue] = {}
        self._last[batch.queue] = value
        self._now.append({batch.queue: value})

    def rests(self, batch: Batch, waits: Iterable[Waited]) -> None:
        """Note that a batch with these waits was left out."""
        values = {batch.queue: self._last[batch.queue]}
        for queue, value, _ in waits:
            values[queue] = max(value, values.get(queue, 0))
        self._owed[batch.queue] = values
        self._now.append(values)
