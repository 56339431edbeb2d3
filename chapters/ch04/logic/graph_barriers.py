"""Which barriers a frame needs, and no others.

The life of a resource is cut into *epochs*: a pass that writes it is one, and passes in a row that only read it in the
same layout are one together. Within an epoch nothing has to happen; between two epochs stands exactly one barrier, in
front of the first pass of the later one, that waits for all of the earlier one and makes its writing visible to all of
the later one.

    step            0          1          2          3
    depth        write      read       read       write        epochs: 0 | 1 2 | 3
                        ^barrier                ^barrier

A frame is one turn of a wheel: what lasts is left by a frame as the next one finds it. So the barrier of a first epoch
waits for the last epoch of the frame before, and only what no frame leaves behind has to be made once, in a prologue.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

from .graph_memory import users_before
from .graph_states import conflict, merged
from .graph_types import PREVIOUS, UNTOUCHED, Barrier, External, Memory, Resource, Touch

Touches = Sequence[Mapping[str, Touch]]
"""By step: how the pass touches each resource; a history that is read has `PREVIOUS` behind its name."""


@dataclass(frozen=True)
class Epoch:
    """Steps in a row that use a resource without anything happening in between."""

    first: int
    last: int
    touch: Touch


@dataclass(frozen=True)
class Plan:
    """The barriers of a frame: by step, those before the first frame, and those behind the last step."""

    steps: tuple[tuple[Barrier, ...], ...]
    prologue: tuple[Barrier, ...]
    epilogue: tuple[Barrier, ...]


@dataclass(frozen=True)
class _Placed:
    """A barrier in front of step `step`, and the last step that uses what it waits for; None: none of a frame."""

    barrier: Barrier
    step: int
    since: int | None


def plan_barriers(
    touches: Touches, resources: Mapping[str, Resource], externals: Mapping[str, External], memory: Memory
) -> Plan:
    """Return the barriers of a frame whose steps touch resources like this, frame after frame."""
    epochs = _epochs(touches)
    users = users_before(memory)
    found: list[_Placed] = []
    prologue, epilogue = [], []
    for name in sorted(epochs):
        mine = epochs[name]
        for before, after in pairwise(mine):
            found.append(_Placed(Barrier(name, before.touch, after.touch), after.first, before.last))
        first, last = mine[0], mine[-1]
        resource = resources[name.removesuffix(PREVIOUS)]
        if resource.life == "transient":
            found.append(_take_over(name, users[name], epochs))
        elif resource.life == "external":
            external = externals[name]
            if conflict(external.enters, first.touch):
                found.append(_Placed(Barrier(name, external.enters, first.touch), first.first, None))
            if external.leaves is not None and conflict(last.touch, external.leaves):
                epilogue.append(Barrier(name, last.touch, external.leaves))
        else:
            # Who touched this image last: the same step of the frame before, or of a history the other parity.
            other = {"kept": name, "history": resource.name if name.endswith(PREVIOUS) else name + PREVIOUS}
            before = epochs[other[resource.life]][-1]
            discard = not name.endswith(PREVIOUS)
            if discard or conflict(before.touch, first.touch):
                barrier = Barrier(name, before.touch, first.touch, discard)
                found.append(_Placed(barrier, first.first, before.last))
            if not discard:
                prologue.append(Barrier(name, UNTOUCHED, before.touch, discard=True))
    steps: list[list[Barrier]] = [[] for _ in touches]
    for one in _without_vain(found, len(touches)):
        steps[one.step].append(one.barrier)
    return Plan(tuple(map(tuple, steps)), tuple(prologue), tuple(epilogue))


def _epochs(touches: Touches) -> dict[str, list[Epoch]]:
    """Return the epochs of each resource, in the order of the steps."""
    epochs: dict[str, list[Epoch]] = defaultdict(list)
    for step, used in enumerate(touches):
        for name, touch in used.items():
            mine = epochs[name]
            both = merged(mine[-1].touch, touch) if mine else None
            if both is None or both.writes:
                mine.append(Epoch(step, step, touch))
            else:
                mine[-1] = Epoch(mine[-1].first, step, both)
    # A history that is read in both frames in the same layout is made visible to both by one barrier.
    for name in [name for name in epochs if name.endswith(PREVIOUS)]:
        current = epochs[name.removesuffix(PREVIOUS)]
        both = merged(current[-1].touch, epochs[name][0].touch)
        if both is not None and not both.writes:
            current[-1] = replace(current[-1], touch=both)
            epochs[name][0] = replace(epochs[name][0], touch=both)
    return epochs


def _take_over(name: str, users: Sequence[str], epochs: Mapping[str, Sequence[Epoch]]) -> _Placed:
    """Return the barrier with which a transient takes over its memory from those who used it before."""
    last = [epochs[user][-1] for user in users]
    writes = [epoch.touch for epoch in last if epoch.touch.writes]
    before = Touch(
        last[0].touch.layout,
        frozenset().union(*(epoch.touch.stages for epoch in last)),
        # What was only read at last has been made available already; it is enough to wait.
        frozenset().union(*(touch.access for touch in writes)),
        bool(writes),
    )
    first = epochs[name][0]
    others = tuple(user for user in users if user != name)
    # The latest of them in the frame, or else in the one before, bounds what may imply the wait.
    since = max((epoch.last for epoch in last), key=lambda step: step if step < first.first else step - 1e9)
    return _Placed(Barrier(name, before, first.touch, True, others), first.first, since)


# --- waiting in vain ---


def _without_vain(found: Sequence[_Placed], count: int) -> list[_Placed]:
    """Leave out barriers that only wait, where others of the frame make the same passes wait already.

    Only buffers, and images that stay in one layout, have such: they are read, and then written again.
    """
    at: list[list[Barrier]] = [[] for _ in range(count)]
    for one in found:
        at[one.step].append(one.barrier)
    for one in found:
        if one.since is not None and _only_waits(one.barrier):
            at[one.step].remove(one.barrier)
            between = at[one.since + 1 : one.step + 1]
            if one.since >= one.step:  # the step is one of the next frame
                between = [*at[one.since + 1 :], *at[: one.step + 1]]
            if not _implied(one.barrier, between):
                at[one.step].append(one.barrier)
    kept = {(step, barrier) for step, barriers in enumerate(at) for barrier in barriers}
    return [one for one in found if (one.step, one.barrier) in kept]


def _only_waits(barrier: Barrier) -> bool:
    before, after = barrier.before, barrier.after
    return not before.writes and before.layout == after.layout and (not barrier.discard or after.layout == "")


def _implied(barrier: Barrier, between: Iterable[Sequence[Barrier]]) -> bool:
    """Whether every stage that the barrier waits for is waited for already, through chains of others.

    A barrier of a later step takes up where one of an earlier step ended, if it waits for a stage that was made to
    wait there; two of the same step do not take each other up.
    """
    reached = {stage: {stage} for stage in barrier.before.stages}
    held: dict[str, set[str]] = {stage: set() for stage in barrier.before.stages}
    for barriers in between:
        for stage, reach in reached.items():
            more = set().union(*(one.after.stages for one in barriers if one.before.stages & reach))
            reach |= more
            held[stage] |= more
    return all(barrier.after.stages <= stages for stages in held.values())
