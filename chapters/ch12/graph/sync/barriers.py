"""The barriers of a frame: the necessary ones and no others.

The uses of a resource are divided into *epochs*. A pass that writes it is an epoch. Consecutive passes that only read
it in the same layout are one epoch together. Within an epoch no barrier is needed. Between two epochs there is exactly
one barrier, before the first pass of the later epoch: it waits for all passes of the earlier epoch, and makes their
writes visible to all passes of the later one.

    step            0          1          2          3
    depth        write      read       read       write        epochs: 0 | 1 2 | 3
                        ^barrier                ^barrier

Frames repeat: each leaves lasting resources in the state that the next frame expects. So the barrier of the first epoch
waits for the last epoch of the previous frame. Before the first frame a prologue replaces the previous frame.
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
"""By step, the touch of each resource; a history that is read has the suffix `PREVIOUS`."""


Resources = Mapping[str, Resource]
Externals = Mapping[str, External]


@dataclass(frozen=True)
class Epoch:
    """Consecutive uses of a resource without a barrier between them."""

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
    """The barriers of a frame: by step, before the first frame, and after the last step."""

    steps: tuple[tuple[Barrier, ...], ...]
    prologue: tuple[Barrier, ...]
    epilogue: tuple[Barrier, ...]


@dataclass(frozen=True)
class _Placed:
    """A barrier before step `step`. `since` has, by stage, the last step that it waits for (below 0: in the previous
    frame)."""

    barrier: Barrier
    step: int
    since: Mapping[str, int]
    ready: bool = False
    """Whether the contents are visible to all readers already."""


def plan_barriers(
    touches: Touches, resources: Resources, externals: Externals, memory: Memory, lanes: Lanes | None = None
) -> Plan:
    """Return the barriers of a frame with these touches; the frame repeats. `lanes` is for several queues."""
    epochs = _epochs(touches)
    users = users_before(memory)
    placed: list[_Placed] = []
    prologue, epilogue = (lanes.planned.prologue, []) if lanes else ([], [])
    placed += [_Placed(*entry) for entry in lanes.placed()] if lanes else []
    for name in sorted(epochs):
        chain = epochs[name]
        resource = resources[name.removesuffix(PREVIOUS)]
        if lanes and lanes.crosses(name):
            if resource.life == "transient":
                placed += _aliasing(name, users[name], epochs, len(touches), lanes)
            continue
        if name in externals and covers(externals[name].enters, chain[0].touch):
            # No barrier before the first use: later barriers wait for the owner's use, too.
            enters = externals[name].enters
            touch = merged(enters, chain[0].touch) or chain[0].touch
            chain[0] = Epoch(chain[0].first, {**dict.fromkeys(enters.stages, -1), **chain[0].ends}, touch)
        ready = name in externals and externals[name].enters == Touch(
            chain[0].touch.layout, frozenset(), frozenset()
        )
        since_step = chain[0].first
        for before, after in pairwise(chain):
            ready &= not before.touch.writes and before.touch.layout == after.touch.layout
            since_step = before.first if before.touch.writes or before.touch.layout else since_step
            seen = lanes is not None and lanes.visible(since_step, before.touch, after.first, after.touch)
            barrier = Barrier(name, before.touch, after.touch)
            placed.append(_Placed(barrier, after.first, before.ends, ready or seen))
        first, last = chain[0], chain[-1]
        if resource.life == "transient":
            placed += _aliasing(name, users[name], epochs, len(touches), lanes)
        elif resource.life == "external":
            external = externals[name]
            if not covers(external.enters, first.touch):
                barrier, since = (
                    Barrier(name, external.enters, first.touch),
                    dict.fromkeys(external.enters.stages, -1),
                )
                placed.append(_Placed(barrier, first.first, since))
            # Contents that the frame only reads stay visible to their readers.
            known = [last.touch]
            if len(chain) == 1 and not last.touch.writes and external.enters.layout == last.touch.layout:
                known.append(external.enters)
            if external.leaves is not None and not any(covers(touch, external.leaves) for touch in known):
                epilogue.append(Barrier(name, last.touch, external.leaves))
        else:
            # The last touch of this image: in the previous frame; for a history under its other name.
            other = {"kept": name, "history": resource.name if name.endswith(PREVIOUS) else name + PREVIOUS}
            before = epochs[other[resource.life]][-1]
            discard = not name.endswith(PREVIOUS)
            if discard or conflict(before.touch, first.touch):
                barrier = Barrier(name, before.touch, first.touch, discard)
                placed.append(_Placed(barrier, first.first, _earlier(before.ends, len(touches))))
            if not discard and before.touch.layout:  # buffers have no layout
                on = lanes.begins(first.first) if lanes else None
                prologue.append(Barrier(name, UNTOUCHED, before.touch, discard=True, hand_over=on))
    steps: list[list[Barrier]] = [[] for _ in (*touches, epilogue)]
    for step, barrier in _without_redundant(placed, epilogue, len(touches), lanes):
        steps[step].append(barrier)
    return Plan(tuple(map(tuple, steps[:-1])), tuple(prologue), tuple(steps[-1]))


def _epochs(touches: Touches) -> dict[str, list[Epoch]]:
    """Return the epochs of each resource in the order of the steps."""
    epochs: dict[str, list[Epoch]] = defaultdict(list)
    for step, used in enumerate(touches):
        for name, touch in used.items():
            chain = epochs[name]
            combined = merged(chain[-1].touch, touch) if chain else None
            if combined is None or combined.writes:
                chain.append(Epoch(step, dict.fromkeys(touch.stages, step), touch))
            else:
                ends = {**chain[-1].ends, **dict.fromkeys(touch.stages, step)}
                chain[-1] = Epoch(chain[-1].first, ends, combined)
    # One barrier makes a history visible to its readers in both frames, if their layout is the same.
    for name in [name for name in epochs if name.endswith(PREVIOUS)]:
        current = epochs[name.removesuffix(PREVIOUS)]
        combined = merged(current[-1].touch, epochs[name][0].touch)
        if combined is not None and not combined.writes:
            current[-1] = replace(current[-1], touch=combined)
            old = epochs[name][0]
            ends = {**_earlier(current[-1].ends, len(touches)), **old.ends}
            epochs[name][0] = replace(old, touch=combined, ends=ends)
    return epochs


def _earlier(ends: Mapping[str, int], count: int) -> dict[str, int]:
    """Return steps of a frame of `count` steps relative to the next frame: -1 is the epilogue, -2 the last step."""
    return {stage: step - count - 1 for stage, step in ends.items()}


def _aliasing(
    name: str, users: Sequence[str], epochs: Epochs, count: int, lanes: Lanes | None
) -> list[_Placed]:
    """Return the barrier between the last users of a transient's memory and the transient, if it needs one."""
    first = epochs[name][0]
    last: Sequence[Behind] = [epochs[user][-1] for user in users] if not lanes else ()
    behind: frozenset[str] = frozenset()  # the stages of waits for other queues
    if lanes:
        last, behind = lanes.aliased(users, epochs, first.first, first.touch)
        if not last and not behind:
            return []
    writes = [epoch.touch for epoch in last if epoch.touch.writes]
    before = Touch(
        last[0].touch.layout if last else "undefined",
        behind.union(*(epoch.touch.stages for epoch in last)),
        # Reads need no availability operation: an execution dependency is enough.
        frozenset().union(*(touch.access for touch in writes)),
        bool(writes),
    )
    replaced = tuple(user for user in users if user != name)
    since: dict[str, int] = {}
    for epoch in last:
        steps = epoch.ends if epoch.last < first.first else _earlier(epoch.ends, count)
        since |= {stage: max(step, since.get(stage, step)) for stage, step in steps.items()}
    return [_Placed(Barrier(name, before, first.touch, True, replaced), first.first, since)]


# --- redundant barriers ---


def _without_redundant(
    candidates: Sequence[_Placed], epilogue: Sequence[Barrier], count: int, lanes: Lanes | None
) -> Iterator[tuple[int, Barrier]]:
    """Yield (step, barrier), without the execution barriers that other barriers imply.

    Execution barriers occur for buffers, and for images that stay in one layout: a write after reads.
    """
    at: list[list[Barrier]] = [[] for _ in range(count)] + [[*epilogue]]
    waits: list[_Placed] = []
    for placed in candidates:
        if lanes and lanes.redundant(placed.barrier, placed.step, placed.since):
            continue
        if placed.since and _is_execution_only(placed):
            waits.append(placed)
        else:
            at[placed.step].append(placed.barrier)
    # Barriers that the rest implies are removed at once. Others may rely on each other, and are tried one by one.
    waits = [placed for placed in waits if not _implied(placed, at, lanes)]
    for placed in waits:
        at[placed.step].append(placed.barrier)
    removed: list[_Placed] = []
    for placed in waits:
        at[placed.step].remove(placed.barrier)
        if all(_implied(other, at, lanes) for other in (placed, *removed)):
            removed.append(placed)
        else:
            at[placed.step].append(placed.barrier)
    for placed in candidates if lanes else ():
        if lanes and placed.barrier not in at[placed.step]:
            lanes.extend_waits(placed.step, placed.since, placed.barrier.after.stages)
    for step, barriers in enumerate(at):
        yield from ((step, barrier) for barrier in sorted(barriers, key=lambda barrier: barrier.resource))


def _is_execution_only(placed: _Placed) -> bool:
    """Whether the barrier is an execution dependency only: no availability, visibility or layout transition."""
    before, after = placed.barrier.before, placed.barrier.after
    if placed.barrier.discard:
        return not before.writes and after.layout == ""
    reads = {access for access in after.access if not access.endswith("_write")}
    seen = placed.ready or (after.stages <= before.stages and reads <= before.access)
    return not before.writes and before.layout == after.layout and seen


def _implied(placed: _Placed, at: Sequence[Sequence[Barrier]], lanes: Lanes | None) -> bool:
    """Whether chains of other barriers already wait for every stage that this barrier waits for.

    A barrier of a later step continues a barrier of an earlier step if its source stages include a destination stage of
    the earlier barrier. Two barriers of the same step do not form a chain.
    """
    for stage, last in placed.since.items():
        if lanes and lanes.orders(placed.step, last):
            continue
        reached: set[str] = set()
        for step in range(last + 1, placed.step + 1):
            sources = reached | {stage}
            if lanes and lanes.queue(step) != lanes.queue(placed.step):
                continue
            for other in at[step % len(at)]:
                if not sources.isdisjoint((other.after if other.hand_over else other.before).stages):
                    reached |= other.after.stages
            if placed.barrier.after.stages <= reached:
                break
        else:
            return False
    return True
