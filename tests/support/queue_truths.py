"""Several queues that run what a compiled frame submits, in any order that its waits allow: a simulated device.

The CPU submits frame after frame, at most `slots` of them ahead of what all queues are done with. Each queue takes its
batches in order, and begins one when all that it waits for was signalled; which queue goes on next is drawn by lot.
What happens then is held to the books of `hazards.py`, with two things more:

- An image that the frame makes belongs to one queue at a time. It goes to another one by a release and an acquisition
  that say the same, of which the second comes behind the first; or its content is given up.
- What the CPU waited for comes before everything that it submits afterwards.

Nothing here looks at how waits are found. A frame that stands still, since everybody waits, is a hazard as well.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from random import Random
from typing import Any

from tests.support.graph_truths import PREVIOUS, Truth, _dependency, _pairs, _taken, places_of
from tests.support.hazards import (
    ALL_STAGES,
    Barriers,
    Dependency,
    Event,
    Given,
    Range,
    Signal,
    Use,
    Wait,
    _Done,
    _Gpu,
)

QUEUES = ("graphics", "compute")
HANDED = "released"
SIGNALLED = (*ALL_STAGES, HANDED)

Piece = tuple[Any, ...]
"""What is left out of a frame: ("step" | "releases", step, number), ("prologue" | "epilogue", number), ("wait", batch,
number)."""


@dataclass(frozen=True)
class HandOver:
    """One half of what moves an image from one queue to another: `queue` is the one on which it runs."""

    resource: str
    ends: tuple[str, str]
    before: Any
    after: Any
    queue: str

    @property
    def says(self) -> tuple[Any, ...]:
        """What both halves have in common."""
        return self.ends, self.before.layout, self.after.layout


@dataclass(frozen=True)
class Paced:
    """From here on a queue runs what was submitted after the CPU waited for these semaphores."""

    semaphores: frozenset[str]
    queue: str


class _Device(_Gpu):
    """The books of a GPU, and who owns which image. `own` are the images that belong to one queue at a time."""

    def __init__(self, places: Mapping[str, Range], own: frozenset[str]) -> None:
        super().__init__(places)
        self._own = own
        self._owners: dict[str, Any] = {}
        """The queue, or what a release says."""

    def take(self, number: int, event: Event | HandOver | Paced) -> None:
        """Run one event."""
        self._now = number
        match event:
            case HandOver():
                self._release(event) if event.queue == event.ends[0] else self._acquire(event)
            case Paced():
                for done in self._everything():
                    if not done.signals.isdisjoint(event.semaphores):
                        done.ordered.update((event.queue, stage) for stage in ALL_STAGES)
                        done.released.update((event.queue, stage) for stage in ALL_STAGES)
            case _:
                self._check_owner(event)
                self.run(number, event)

    def _check_owner(self, event: Event) -> None:
        used = [(event.resource, False)] if isinstance(event, Use) else []
        if isinstance(event, Barriers):
            used = [(one.resource, one.old == "undefined") for one in event.dependencies]
        for name, given_up in used:
            if name.split("#")[0] not in self._own:
                continue
            if given_up:
                self._owners[name] = event.queue
            elif self._owners.get(name) != event.queue:
                self._report(event.queue, name, f"belongs to {self._owners.get(name)}")

    def _release(self, event: HandOver) -> None:
        name, first = event.resource, {(event.queue, stage) for stage in event.before.stages}
        if self._owners.get(name) != event.queue:
            self._report("a release", name, f"belongs to {self._owners.get(name)}")
        if self._layout(name) != event.before.layout:
            self._report("a release", name, f"is in layout '{self._layout(name)}'")
        for part in self._bytes(name):
            for done in part.done:
                made = done.stage in first and done.access in event.before.access
                self._check_change(
                    name, done, done.in_scope(first), made or not first.isdisjoint(done.released)
                )
            part.reads[event.queue, HANDED] = _Done("its release", (event.queue, HANDED), HANDED)
        self._owners[name] = event.says

    def _acquire(self, event: HandOver) -> None:
        name, second = event.resource, {(event.queue, stage) for stage in event.after.stages}
        if self._owners.get(name) != event.says:
            self._report("an acquisition", name, f"of {event.says} belongs to {self._owners.get(name)}")
        for part in self._bytes(name):
            released = part.reads.get((event.ends[0], HANDED))
            if released is None or not second <= released.ordered:
                self._report("an acquisition", name, "is not ordered behind a release")
            part.reads.pop((event.ends[0], HANDED), None)
        after = event.after
        layouts = event.before.layout, after.layout
        one = Dependency(name, after.stages, frozenset(), after.stages, after.access, *layouts)
        self._owners[name] = event.queue
        self.run(self._now, Barriers((one,), event.queue))


# --- what is submitted ------------------------------------------------------------------------------------------------


class Submissions:
    """A compiled frame as it is submitted, frame after frame, with one piece left out.

    `slotted` are the externals of which each slot has one of its own, or of which there are so many `copies`. Of any
    other external its owner has another one in each frame.
    """

    def __init__(
        self,
        truth: Truth,
        graph: Any,
        skip: Piece | None = None,
        slots: int = 2,
        slotted: Sequence[str] = (),
        copies: int = 0,
    ) -> None:
        self.truth, self.graph, self.skip, self.slots, self.slotted = truth, graph, skip, slots, slotted
        self.copies = copies or slots
        used = truth.resources()
        self.histories = {name for name in used if truth.life(name) == "history"}
        self.externals = {name: one for name, one in truth.externals.items() if name in used}
        self.own = frozenset(name for name in used if truth.is_image(name) and name not in self.externals)

    def physical(self, resource: str, frame: int) -> str:
        """The name of the image or buffer behind a resource in a frame."""
        name = resource.removesuffix(PREVIOUS)
        if name in self.histories:
            return f"{name}#{(frame + (name != resource)) % 2}"
        if name in self.slotted:
            return f"{name}#{frame % self.copies}"
        return f"{name}#{frame}" if name in self.externals else name

    def _barriers(
        self, key: Piece, listed: Sequence[Any], queue: str, frame: int
    ) -> Iterator[Event | HandOver]:
        plain = []
        for number, one in enumerate(listed):
            if (*key, number) == self.skip:
                continue
            name = self.physical(one.resource, frame)
            if one.hand_over is None or one.hand_over[0] == one.hand_over[1]:
                plain.append(_dependency(one, name))
            else:
                yield HandOver(name, one.hand_over, one.before, one.after, queue)
        if plain:
            yield Barriers(tuple(plain), queue)

    def prologue(self) -> Iterator[Event | HandOver]:
        """What happens once: each on its queue, and the CPU waits for all of it."""
        for number, one in enumerate(self.graph.prologue):
            queue = one.hand_over[0] if one.hand_over else "graphics"
            if ("prologue", number) != self.skip:
                yield from self._barriers((), [one], queue, 0)
        for queue in QUEUES:
            yield Signal(f"prologue {queue}", SIGNALLED, queue)
        for queue in QUEUES:
            yield from (Wait(f"prologue {other}", queue=queue) for other in QUEUES)

    def batch(self, frame: int, number: int) -> Iterator[Event | HandOver]:
        """What a batch of a frame does, its waits left out."""
        batch = self.graph.batches[number]
        for step in batch.steps:
            yield from self._barriers(("step", step), self.graph.steps[step].barriers, batch.queue, frame)
            for use in self.truth.uses(self.graph.steps[step].name):
                # Shaders leave out a history that is not there yet, by a bit of the frame's constants.
                needs = use.needs and not (frame == 0 and use.resource.endswith(PREVIOUS))
                yield replace(
                    use, resource=self.physical(use.resource, frame), needs=needs, queue=batch.queue
                )
            yield from self._barriers(("releases", step), self.graph.steps[step].releases, batch.queue, frame)
        if number == max(
            (i for i, one in enumerate(self.graph.batches) if one.queue == "graphics"), default=-1
        ):
            yield from self._barriers(("epilogue",), self.graph.epilogue, "graphics", frame)
            for name, external in self.externals.items():
                leaves = external.leaves
                if leaves is not None and leaves.stages - {"host"}:
                    taken = _taken(name, leaves)
                    yield replace(taken, resource=self.physical(name, frame), queue="graphics")
        yield Signal(_semaphore(frame, number), SIGNALLED, batch.queue)

    def waits(self, frame: int, number: int) -> list[Wait]:
        """The waits of a batch: the first frame waits for none before it."""
        batch = self.graph.batches[number]
        return [
            Wait(_semaphore(frame - wait.before, wait.batch), tuple(wait.stages), batch.queue)
            for i, wait in enumerate(batch.waits)
            if ("wait", number, i) != self.skip and frame >= wait.before
        ]

    def given(self, frame: int, ready: bool) -> Iterator[Given]:
        """What owners hand over to a frame: what is `ready` as it is submitted, or what graphics still uses."""
        for name, external in self.externals.items():
            touch = external.enters
            fresh = name not in self.slotted or frame < self.copies
            if fresh and ready == (not touch.stages):
                yield Given(self.physical(name, frame), _pairs(touch), touch.layout, "graphics")


def _semaphore(frame: int, batch: int) -> str:
    return f"frame {frame} batch {batch}"


def on_queues(nodes: Sequence[Any], seed: int, share: float = 0.7) -> tuple[Any, ...]:
    """Return nodes of which as many as that ask for the compute queue, of those that can."""
    lot = Random(seed)
    return tuple(
        replace(node, queue="compute") if node.kind != "graphics" and lot.random() < share else node
        for node in nodes
    )


def pieces(graph: Any) -> list[Piece]:
    """Everything that can be left out of a compiled frame."""
    found: list[Piece] = [("prologue", i) for i in range(len(graph.prologue))]
    found += [("epilogue", i) for i in range(len(graph.epilogue))]
    for number, step in enumerate(graph.steps):
        found += [("step", number, i) for i in range(len(step.barriers))]
        found += [("releases", number, i) for i in range(len(step.releases))]
    return found + [
        ("wait", number, i) for number, one in enumerate(graph.batches) for i in range(len(one.waits))
    ]


# --- run --------------------------------------------------------------------------------------------------------------


def hazards_of(
    made: Submissions, seed: int = 0, frames: int = 4, together: bool = False, stop: bool = False
) -> list[str]:
    """Run frames in an order drawn by lot; return what went wrong. `together`: both queues are one in truth.

    `stop`: return at the first one.
    """
    lot = Random(seed)
    device = _Device(places_of(made.graph), made.own)
    count = 0
    favourite = lot.choice((None, "submit", *QUEUES))

    def run(events: Iterator[Event | HandOver] | Sequence[Any]) -> None:
        nonlocal count
        for event in events:
            device.take(count, event)
            count += 1

    run(made.prologue())
    lanes: dict[str, list[tuple[int, int]]] = {queue: [] for queue in QUEUES}
    signalled: set[str] = set()
    running: dict[str, Iterator[Any]] = {}
    entered: set[tuple[str, int]] = set()
    submitted = 0
    numbers = range(len(made.graph.batches))

    def is_done(frame: int) -> bool:
        return all(_semaphore(frame, number) in signalled for number in numbers)

    while True:
        able = list(running)
        for lane, queued in lanes.items():
            if lane not in running and queued:
                needed = {wait.semaphore for wait in made.waits(*queued[0])}
                if needed <= signalled:
                    able.append(lane)
        if submitted < frames and (submitted < made.slots or is_done(submitted - made.slots)):
            able.append("submit")
        if not able:
            break
        chosen = favourite if favourite in able and lot.random() < 0.8 else lot.choice(sorted(able))
        if chosen == "submit":
            if submitted >= made.slots:
                run([Wait(_semaphore(submitted - made.slots, n), queue="host") for n in numbers])
            run(made.given(submitted, ready=True))
            for number in numbers:
                lanes["graphics" if together else made.graph.batches[number].queue].append(
                    (submitted, number)
                )
            submitted += 1
        elif chosen in running:
            event = next(running[chosen], None)
            if event is None:
                del running[chosen]
            else:
                run([event])
                if isinstance(event, Signal):
                    signalled.add(event.semaphore)
        else:
            frame, number = lanes[chosen].pop(0)
            queue = made.graph.batches[number].queue
            if (queue, frame) not in entered:
                entered.add((queue, frame))
                before = {_semaphore(f, n) for f in range(frame - made.slots + 1) for n in numbers}
                run([Paced(frozenset(before), queue)])
                if queue == "graphics":
                    run(made.given(frame, ready=False))
            run(made.waits(frame, number))
            running[chosen] = made.batch(frame, number)
        if stop and device.hazards:
            break
    found = [str(hazard) for hazard in device.hazards]
    if not found and (submitted < frames or any(lanes.values())):
        found.append(f"everybody waits: {lanes}")
    if not found:
        for frame in range(frames):
            run([Wait(_semaphore(frame, n), queue="host") for n in numbers])
            for name, external in made.externals.items():
                if external.leaves is not None and not external.leaves.stages - {"host"}:
                    run([replace(_taken(name, external.leaves), resource=made.physical(name, frame))])
        found = [str(hazard) for hazard in device.hazards]
    return found
