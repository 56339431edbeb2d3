"""Frames submitted to two queues: is all that is overwritten no longer read, and is nothing waited for in vain?"""

from __future__ import annotations

from typing import Any

from backends.contract import Access
from tools.exercises.checking import Given

SLOTS = 2
FRAMES = 6

Batch = tuple[int, int]
"""The number of a frame, and that of a batch in it."""


def check(given: Given) -> None:
    """An image that compute writes and graphics reads last, a buffer, one for each slot, and a pass that rests."""
    image = Access("fog", "storage", "rgba16f"), Access("fog", "sampled")
    buffer = Access("fog", "storage", bytes=256), Access("fog", "storage", stages=("vertex",))
    _Frames(given, "an image", *image).hold()
    _Frames(given, "a buffer", *buffer).hold()
    _Frames(given, "a buffer for each slot", *buffer, slotted=True).hold()
    resting = _Frames(given, "a buffer that is written in every third frame", *buffer)
    resting.rests = {frame for frame in range(FRAMES) if frame % 3}
    resting.hold()


class _Frames:
    """Frames in which `fog` computes something, `draw` reads it and `tonemap` comes last; and their waits."""

    def __init__(self, given: Given, what: str, made: Access, read: Access, slotted: bool = False) -> None:
        words = given.module("graph.types")
        nodes = [
            words.Node("fog", (), (made,), queue="compute"),
            words.Node("draw", (read,), (Access("lit", "color", "rgba8"),)),
            words.Node("tonemap", (Access("lit", "sampled"),), (Access("picture", "color", "rgba8"),)),
        ]
        free = words.Touch("", frozenset(), frozenset())
        externals = {"fog": words.External(None, None, free, bytes=256)} if slotted else None
        compiler: Any = given.module("graph.frame_graph")
        self.graph = compiler.compile_graph(
            nodes, (8, 8), {"picture"}, externals, queues=("graphics", "compute")
        )
        self._given, self._what, self._slotted = given, what, slotted
        self._logic: Any = given.module("graph.execute.batches")
        self.rests: set[int] = set()

    def hold(self) -> None:
        """Submit frames, and look at each batch: what it waits for, and which batches it may overtake."""
        reached = self._logic.Reached()
        batches = self._logic.batches_of(self.graph)
        values = {"graphics": 0, "compute": 0}
        signalled: dict[tuple[str, int], Batch] = {}
        behind: dict[Batch, set[Batch]] = {}
        last: dict[str, Batch] = {}
        for frame in range(FRAMES):
            reached.begin_frame()
            over = {one for one in behind if one[0] <= frame - SLOTS}  # the CPU has waited for them
            for number, batch in enumerate(batches):
                try:
                    asked = list(reached.waits(batch))
                except IndexError:
                    self._given.need(frame, "In front of the first frame there is none to wait for.")
                    raise
                if frame in self.rests and self._logic.can_rest(self.graph, batch):
                    reached.rests(batch, asked)
                    continue
                me = frame, number
                known = set(over)
                if batch.queue in last:
                    known |= {last[batch.queue]} | behind[last[batch.queue]]
                for queue, value, _ in asked:
                    other = signalled.get((queue, value))
                    self._given.need(
                        other is not None,
                        f"Batch {number} of frame {frame} waits for {value} of {queue}, which no batch signals "
                        "before: it never runs.",
                    )
                    assert other is not None
                    named = {(frame - wait.before, wait.batch) for wait in batch.waits}
                    self._given.need(
                        self.rests or other in named,
                        f"With {self._what}, batch {number} of frame {frame} waits for batch {other[1]} of frame "
                        f"{other[0]}, and the graph does not ask for that: nothing runs beside it.",
                    )
                    known |= {other} | behind[other]
                behind[me], last[batch.queue] = known, me
                values[batch.queue] += 1
                signalled[batch.queue, values[batch.queue]] = me
                reached.submitted(batch, asked, values[batch.queue])
                self._look(me, batch, behind)

    def _look(self, me: Batch, batch: Any, behind: dict[Batch, set[Batch]]) -> None:
        """Look whether a batch comes behind all those that use what it writes, or write what it reads."""
        mine = self._uses(batch)
        for other in (one for one in behind if one != me):
            theirs = self._uses(self._logic.batches_of(self.graph)[other[1]])
            same = not self._slotted or (me[0] - other[0]) % SLOTS == 0
            meets = same and "fog" in mine.keys() & theirs.keys() and (mine["fog"] or theirs["fog"])
            what = "writes over fog while" if mine.get("fog") else "reads fog while"
            then = "writes it" if theirs.get("fog") else "may still read it"
            self._given.need(
                not meets or other in behind[me],
                f"With {self._what}, frame {me[0]} {what} frame {other[0]} {then}: neither waits.",
            )

    def _uses(self, batch: Any) -> dict[str, bool]:
        """Return the resources of a batch, with whether it writes them."""
        steps = [self.graph.steps[place] for place in batch.steps]
        written = {name for step in steps for name in step.writes}
        return {name: name in written for step in steps for name in (*step.reads, *step.writes)}
