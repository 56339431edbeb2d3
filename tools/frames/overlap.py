"""What can happen at the same time: the batches of a frame in lanes, one for each queue, and which steps overlap.

Two steps can overlap if nothing orders them: their batches are on two queues, and no way of waits leads from one to the
other. A step can overlap with one of the frame before as well. On a device with one queue they run in the order of the
batches all the same. Graphs of chapter 4 have no batches, and so nothing to tell.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

Graph: TypeAlias = Any
"""What a chapter has compiled; it and its parts are those of the chapter's `graph/types.py`."""

Batch: TypeAlias = Any
Barrier: TypeAlias = Any


@dataclass(frozen=True)
class Overlap:
    """With which steps one can run at the same time: those of its own frame, and those of the frame before."""

    now: tuple[int, ...] = ()
    before: tuple[int, ...] = ()


def overlaps(graph: Graph) -> list[Overlap]:
    """Return for each step what it can overlap with; nothing where one batch is submitted."""
    batches = graph.batches
    count = len(batches)
    behind = _behind(batches)
    batch_of = {step: number for number, batch in enumerate(batches) for step in batch.steps}
    found = []
    for step in range(len(graph.steps)):
        mine = batch_of[step]
        others = [
            other
            for other in range(len(graph.steps))
            if batches[batch_of[other]].queue != batches[mine].queue
        ]
        now = [
            other
            for other in others
            if not behind[2 * count + mine] >> (2 * count + batch_of[other]) & 1
            and not behind[2 * count + batch_of[other]] >> (2 * count + mine) & 1
        ]
        before = [other for other in others if not behind[2 * count + mine] >> (count + batch_of[other]) & 1]
        found.append(Overlap(tuple(now), tuple(before)))
    return found


def _behind(batches: Sequence[Batch]) -> list[int]:
    """Return for the batches of three frames, one after the other, all that is done before each begins, as bits."""
    behind: list[int] = []
    last: dict[str, int] = {}
    for frame in range(3):
        for batch in batches:
            number = len(behind)
            mine = 0
            waited = [(frame - wait.before) * len(batches) + wait.batch for wait in batch.waits]
            for other in (*waited, last.get(batch.queue, -1)):
                if other >= 0:
                    mine |= behind[other] | 1 << other
            behind.append(mine)
            last[batch.queue] = number
    return behind


def batches_of(graph: Graph) -> tuple[Batch, ...]:
    """Return what is submitted, in its order; nothing of a graph that knows no queues."""
    return getattr(graph, "batches", ())


def queues(graph: Graph) -> tuple[str, ...]:
    """Return the queues of a frame in the order of the lanes: graphics first."""
    return tuple(
        sorted({batch.queue for batch in graph.batches}, key=lambda queue: (queue != "graphics", queue))
    )


def lines(graph: Graph, stages: Mapping[str, str]) -> Iterator[str]:
    """Yield the text about batches and overlaps, nothing for one batch; `stages` says what each is called."""
    if len(batches_of(graph)) < 2:
        return
    yield "batches, in the order in which they are submitted"
    width = max(map(len, queues(graph)))
    columns = [_steps(batch.steps) for batch in graph.batches]
    digits, wide = len(str(len(columns))), max(map(len, columns))
    for number, (batch, steps) in enumerate(zip(graph.batches, columns, strict=True), 1):
        waits = "; ".join(
            f"{', '.join(sorted(stages.get(one, one) for one in wait.stages))} wait for {wait.batch + 1}"
            + (" of the frame before" if wait.before else "")
            for wait in batch.waits
        )
        yield f"   {number:>{digits}} {batch.queue:<{width}}  {steps:<{wide}}  {waits}"
    yield ""
    yield "at the same time"
    found = overlaps(graph)
    if not any(one.now or one.before for one in found):
        yield "   nothing: each step waits for the one before it"
    for number, one in enumerate(found):
        if graph.steps[number].queue != "graphics" and (one.now or one.before):
            beside = [_steps(one.now)] if one.now else []
            beside += [f"{_steps(one.before)} of the frame before"] if one.before else []
            late = tuple(other for other, mine in enumerate(found) if number in mine.before)
            beside += [f"{_steps(late)} of the frame behind"] if late else []
            yield f"   {number + 1} {graph.steps[number].name} beside {', '.join(beside)}"


def _steps(numbers: Sequence[int]) -> str:
    """Return steps as they are numbered for readers: "1-3 5"; "-" for none."""
    runs: list[list[int]] = []
    for number in numbers:
        if runs and runs[-1][1] == number - 1:
            runs[-1][1] = number
        else:
            runs.append([number, number])
    shown = (f"{first + 1}" if first == last else f"{first + 1}-{last + 1}" for first, last in runs)
    return " ".join(shown) or "-"


def moved_to(barrier: Barrier) -> str:
    """Return which queue takes an image over from which one, in words; "" where it stays."""
    handed = getattr(barrier, "hand_over", None)
    if handed is None:
        return ""
    before, after = handed
    return f", from {before} to {after}" if before != after else f", on {after}"
