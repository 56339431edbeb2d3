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
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

from ..memory.placement import users_before
from ..types import PREVIOUS, UNTOUCHED, Barrier, External, Memory, Resource, Touch
from .crossings import Behind, Lanes
from .states import conflict, covers, merged

Touches = Sequence[Mapping[str, Touch]]
"""By step: how the pass touches each resource; a history that is read has `PREVIOUS` behind its name."""


Resources = Mapping[str, Resource]
Externals = Mapping[str, External]


@dataclass(frozen=True)
class Epoch:
    """Steps in a row that use a resource without anything happening in between."""

    first: int
    ends: Mapping[str, int]
    """The last step of each stage."""
    touch: Touch

    @property
    def last(self) -> int:
        return max(self.ends.values())


Epochs = Mapping[str, Sequence[Epoch]]


@dataclass(frozen=True)
class Plan:
    """The barriers of a frame: by step, those before the first frame, and those behind the last step."""

    steps: tuple[tuple[Barrier, ...], ...]
    prologue: tuple[Barrier, ...]
    epilogue: tuple[Barrier, ...]


@dataclass(frozen=True)
class _Placed:
    """A barrier in front of step `step`, and the last step of each stage that it waits for, below 0 in the frame
    before."""

    barrier: Barrier
    step: int
    since: Mapping[str, int]
    ready: bool = False
    """Whether everybody can read the content already."""


def plan_barriers(
    touches: Touches, resources: Resources, externals: Externals, memory: Memory, lanes: Lanes | None = None
) -> Plan:
    """Return the barriers of a frame whose steps touch resources like this, frame after frame, in `lanes`."""
    epochs = _epochs(touches)
    users = users_before(memory)
    found: list[_Placed] = []
    prologue, epilogue = (lanes.found.prologue, []) if lanes else ([], [])
    found += [_Placed(*one) for one in lanes.placed()] if lanes else []
    for name in sorted(epochs):
        mine = epochs[name]
        resource = resources[name.removesuffix(PREVIOUS)]
        if lanes and lanes.crosses(name):
            if resource.life == "transient":
                found += _take_over(name, users[name], epochs, len(touches), lanes)
            continue
        if name in externals and covers(externals[name].enters, mine[0].touch):
            # Nothing happens before the first use: what comes after it waits for the owner's as well.
            enters = externals[name].enters
            touch = merged(enters, mine[0].touch) or mine[0].touch
            mine[0] = Epoch(mine[0].first, {**dict.fromkeys(enters.stages, -1), **mine[0].ends}, touch)
        ready = name in externals and externals[name].enters == Touch(
            mine[0].touch.layout, frozenset(), frozenset()
        )
        made = mine[0].first
        for before, after in pairwise(mine):
            ready &= not before.touch.writes and before.touch.layout == after.touch.layout
            made = before.first if before.touch.writes or before.touch.layout else made
            seen = lanes is not None and lanes.sees(made, before.touch, after.first, after.touch)
            barrier = Barrier(name, before.touch, after.touch)
            found.append(_Placed(barrier, after.first, before.ends, ready or seen))
        first, last = mine[0], mine[-1]
        if resource.life == "transient":
            found += _take_over(name, users[name], epochs, len(touches), lanes)
        elif resource.life == "external":
            external = externals[name]
            if not covers(external.enters, first.touch):
                barrier, since = (
                    Barrier(name, external.enters, first.touch),
                    dict.fromkeys(external.enters.stages, -1),
                )
                found.append(_Placed(barrier, first.first, since))
            # What the frame only reads is still there for those who could read it before.
            known = [last.touch]
            if len(mine) == 1 and not last.touch.writes and external.enters.layout == last.touch.layout:
                known.append(external.enters)
            if external.leaves is not None and not any(covers(touch, external.leaves) for touch in known):
                epilogue.append(Barrier(name, last.touch, external.leaves))
        else:
            # Who touched this image last: the same step of the frame before, or of a history the other parity.
            other = {"kept": name, "history": resource.name if name.endswith(PREVIOUS) else name + PREVIOUS}
            before = epochs[other[resource.life]][-1]
            discard = not name.endswith(PREVIOUS)
            if discard or conflict(before.touch, first.touch):
                barrier = Barrier(name, before.touch, first.touch, discard)
                found.append(_Placed(barrier, first.first, _earlier(before.ends, len(touches))))
            if not discard and before.touch.layout:  # buffers have no layout to begin in
                on = lanes.begins(first.first) if lanes else None
                prologue.append(Barrier(name, UNTOUCHED, before.touch, discard=True, hand_over=on))
    steps: list[list[Barrier]] = [[] for _ in (*touches, epilogue)]
    for step, barrier in _without_vain(found, epilogue, len(touches), lanes):
        steps[step].append(barrier)
    return Plan(tuple(map(tuple, steps[:-1])), tuple(prologue), tuple(steps[-1]))


def _epochs(touches: Touches) -> dict[str, list[Epoch]]:
    """Return the epochs of each resource, in the order of the steps."""
    epochs: dict[str, list[Epoch]] = defaultdict(list)
    for step, used in enumerate(touches):
        for name, touch in used.items():
            mine = epochs[name]
            both = merged(mine[-1].touch, touch) if mine else None
            if both is None or both.writes:
                mine.append(Epoch(step, dict.fromkeys(touch.stages, step), touch))
            else:
                ends = {**mine[-1].ends, **dict.fromkeys(touch.stages, step)}
                mine[-1] = Epoch(mine[-1].first, ends, both)
    # A history that is read in both frames in the same layout is made visible to both by one barrier.
    for name in [name for name in epochs if name.endswith(PREVIOUS)]:
        current = epochs[name.removesuffix(PREVIOUS)]
        both = merged(current[-1].touch, epochs[name][0].touch)
        if both is not None and not both.writes:
            current[-1] = replace(current[-1], touch=both)
            old = epochs[name][0]
            ends = {**_earlier(current[-1].ends, len(touches)), **old.ends}
            epochs[name][0] = replace(old, touch=both, ends=ends)
    return epochs


def _earlier(ends: Mapping[str, int], count: int) -> dict[str, int]:
    """Return steps of a frame of `count` as the next frame counts them: -1 is its epilogue, -2 its last step."""
    return {stage: step - count - 1 for stage, step in ends.items()}


def _take_over(
    name: str, users: Sequence[str], epochs: Epochs, count: int, lanes: Lanes | None
) -> list[_Placed]:
    """Return the barrier with which a transient takes over its memory from those before it, where one is needed."""
    first = epochs[name][0]
    last: Sequence[Behind] = [epochs[user][-1] for user in users] if not lanes else ()
    behind: frozenset[str] = frozenset()  # where waits for other queues end
    if lanes:
        last, behind = lanes.taken(users, epochs, first.first, first.touch)
        if not last and not behind:
            return []
    writes = [epoch.touch for epoch in last if epoch.touch.writes]
    before = Touch(
        last[0].touch.layout if last else "undefined",
        behind.union(*(epoch.touch.stages for epoch in last)),
        # What was only read at last has been made available already; it is enough to wait.
        frozenset().union(*(touch.access for touch in writes)),
        bool(writes),
    )
    others = tuple(user for user in users if user != name)
    since: dict[str, int] = {}
    for epoch in last:
        steps = epoch.ends if epoch.last < first.first else _earlier(epoch.ends, count)
        since |= {stage: max(step, since.get(stage, step)) for stage, step in steps.items()}
    return [_Placed(Barrier(name, before, first.touch, True, others), first.first, since)]


# --- waiting in vain ---


def _without_vain(
    found: Sequence[_Placed], epilogue: Sequence[Barrier], count: int, lanes: Lanes | None
) -> Iterator[tuple[int, Barrier]]:
    """Yield (step, barrier), without those that only wait where others make the same stages wait already.

    Only buffers, and images that stay in one layout, have such: they are read, and then written again.
    """
    at: list[list[Barrier]] = [[] for _ in range(count)] + [[*epilogue]]
    waits: list[_Placed] = []
    for one in found:
        if lanes and lanes.make_vain(one.barrier, one.step, one.since):
            continue
        if one.since and _only_waits(one):
            waits.append(one)
        else:
            at[one.step].append(one.barrier)
    # Those that the rest implies can go, all at once; among the others each one may be what another one relies on.
    waits = [one for one in waits if not _implied(one, at, lanes)]
    for one in waits:
        at[one.step].append(one.barrier)
    gone: list[_Placed] = []
    for one in waits:
        at[one.step].remove(one.barrier)
        if all(_implied(other, at, lanes) for other in (one, *gone)):
            gone.append(one)
        else:
            at[one.step].append(one.barrier)
    for one in found if lanes else ():
        if lanes and one.barrier not in at[one.step]:
            lanes.rely(one.step, one.since, one.barrier.after.stages)
    for step, barriers in enumerate(at):
        yield from ((step, barrier) for barrier in sorted(barriers, key=lambda barrier: barrier.resource))


def _only_waits(one: _Placed) -> bool:
    """Whether nothing has to be made available, nor visible, nor another layout."""
    before, after = one.barrier.before, one.barrier.after
    if one.barrier.discard:
        return not before.writes and after.layout == ""
    reads = {access for access in after.access if not access.endswith("_write")}
    seen = one.ready or (after.stages <= before.stages and reads <= before.access)
    return not before.writes and before.layout == after.layout and seen


def _implied(one: _Placed, at: Sequence[Sequence[Barrier]], lanes: Lanes | None) -> bool:
    """Whether every stage that the barrier waits for is waited for already, through chains of others.

    A barrier of a later step takes up where one of an earlier step ended, if it waits for a stage that was made to
    wait there; two of the same step do not take each other up.
    """
    for stage, last in one.since.items():
        if lanes and lanes.knows(one.step, last):
            continue
        held: set[str] = set()
        for step in range(last + 1, one.step + 1):
            met = held | {stage}
            if lanes and lanes.queue(step) != lanes.queue(one.step):
                continue
            for other in at[step % len(at)]:
                if not met.isdisjoint((other.after if other.hand_over else other.before).stages):
                    held |= other.after.stages
            if one.barrier.after.stages <= held:
                break
        else:
            return False
    return True
