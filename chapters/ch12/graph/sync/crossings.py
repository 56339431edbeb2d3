"""Resources that several queues use: waits between queues, and queue family ownership transfers of images.

The uses of a resource are divided into epochs, as in `barriers.py`, but an epoch has a part for each queue that reads
the resource in it. Between two epochs there is:

    same queue                 a barrier
    another queue              a crossing: a semaphore wait, which makes all earlier writes visible; enough for buffers
    another queue, an image    a crossing and an ownership transfer: a release after the last step of the one queue, an
                               acquisition before the first step of the other. So an epoch of an image has one queue
    contents discarded         a crossing only: the next user treats the image as undefined

External images are created with concurrent sharing, as all buffers are, so they need no ownership transfer. The owner
of an external uses it on the graphics queue, before and after the frame.

A history has two images. A frame writes one, the next frame reads it as `PREVIOUS`, and the frame after that writes it
again. So its epochs span two frames; all other resources repeat in each frame.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import reduce
from itertools import pairwise
from operator import itemgetter
from typing import Protocol, cast

import numpy as np

from ..types import PREVIOUS, UNTOUCHED, Barrier, External, Resource, Touch
from .batches import Batch
from .queues import GRAPHICS, Clocks, Crossing
from .states import conflict, covers, merged


class Behind(Protocol):
    """The last use of a resource on a queue: its touch, the last step of each stage, and the last of these steps."""

    @property
    def touch(self) -> Touch: ...
    @property
    def ends(self) -> Mapping[str, int]: ...
    @property
    def last(self) -> int: ...


@dataclass(slots=True)
class Part:
    """The steps of one queue in an epoch: the places of the first step, and of the last step of each stage."""

    first: int
    ends: Mapping[str, int]
    touch: Touch

    @property
    def last(self) -> int:
        """Place of the last step."""
        return max(self.ends.values())

    def behind(self) -> Part:
        """Return the part with step numbers instead of places, for a transient."""
        return self.later(-1)

    def later(self, by: int) -> Part:
        """Return the part shifted by `by` places."""
        return Part(self.first + by, {stage: place + by for stage, place in self.ends.items()}, self.touch)


Epoch = dict[str, Part]
"""The parts of an epoch by queue."""


@dataclass
class Planned:
    """The crossings, barriers and releases of resources that several queues use."""

    crossings: list[Crossing] = field(default_factory=list)
    placed: list[tuple[Barrier, int, Mapping[str, int], bool, int]] = field(default_factory=list)
    """Barriers before steps, as in `barriers.py`, where the epilogue follows the last step. Each has the place of the
    write, or of the layout transition, that it depends on."""
    releases: dict[int, list[Barrier]] = field(default_factory=dict)
    """By step, the releases after it."""
    prologue: list[Barrier] = field(default_factory=list)


class Lanes:
    """A frame on several queues. `queues` has the queue of each step, `touches` its touch of each resource."""

    def __init__(
        self,
        queues: Sequence[str],
        touches: Sequence[Mapping[str, Touch]],
        resources: Mapping[str, Resource],
        externals: Mapping[str, External],
    ) -> None:
        self.queues = queues
        self._on = (*queues, GRAPHICS)
        self._used: dict[str, list[tuple[int, str, Touch]]] = {}
        frame = len(queues) + 2
        for step, (queue, used) in enumerate(zip(queues, touches, strict=True)):
            for name, touch in used.items():
                place = step + 1 + frame * name.endswith(PREVIOUS)
                self._used.setdefault(name.removesuffix(PREVIOUS), []).append((place, queue, touch))
        self.planned = Planned()
        self._chains: dict[str, _Chain] = {}
        for name, uses in sorted(self._used.items()):
            external = externals.get(name)
            if external is not None or len({queue for _, queue, _ in uses}) > 1:
                uses = sorted(uses, key=itemgetter(0))
                chain = _Chain(name, uses, resources[name], external, frame, self.planned)
                chain.follow()
                self._chains[name] = chain
        self._clocks = Clocks(queues, self.planned.crossings)

    def crosses(self, name: str) -> bool:
        """Whether several queues use a resource, or another object owns it."""
        return name.removesuffix(PREVIOUS) in self._chains

    def placed(self) -> Iterator[tuple[Barrier, int, Mapping[str, int], bool]]:
        """Yield (barrier, step, last steps that it waits for by stage, whether the contents are visible already)."""
        for barrier, step, since, ready, written in self.planned.placed:
            # After reads, a wait for another queue may already have made the contents visible.
            seen = bool(since) and not barrier.before.writes and self._clocks.orders(step + 1, written)
            if seen:
                self._clocks.extend(written, step + 1, barrier.after.stages)
            yield barrier, step, since, ready or seen

    def begins(self, step: int) -> tuple[str, str] | None:
        """Return the `hand_over` of a prologue barrier on the queue of a step; None for graphics."""
        return None if self.queues[step] == GRAPHICS else (self.queues[step], self.queues[step])

    def releases(self, step: int) -> tuple[Barrier, ...]:
        """Return the releases after a step."""
        return tuple(sorted(self.planned.releases.get(step, ()), key=lambda barrier: barrier.resource))

    def together(self, names: Collection[str]) -> np.ndarray:
        """Return (names, names) bool: the pairs of transients that cannot share memory."""
        uses: list[dict[str, tuple[int, int]]] = [{} for _ in names]
        for name, by_queue in zip(names, uses, strict=True):
            for place, queue, _ in self._used[name]:
                by_queue[queue] = by_queue.get(queue, (place,))[0], place
        return self._clocks.together(uses)

    def queue(self, step: int) -> str:
        """Return the queue of a step in any frame; the epilogue after the last step is on graphics."""
        return self._on[step % len(self._on)]

    def orders(self, step: int, since: int) -> bool:
        """Whether waits for other queues order step `since` before a step of the same queue.

        `since` is below 0 for earlier frames, as in barriers.
        """
        return self._clocks.orders(step + 1, self._place(since))

    def visible(self, written: int, read: Touch, step: int, touch: Touch) -> bool:
        """Whether a wait makes the result of step `written` visible to a step, after the reads of touch `read`."""
        seen = not read.writes and read.layout == touch.layout and self.orders(step, written)
        if seen:
            self._clocks.extend(written + 1, step + 1, touch.stages)
        return seen

    def redundant(self, barrier: Barrier, step: int, since: Mapping[str, int]) -> bool:
        """Whether waits for other queues make a barrier before a step redundant."""
        stays = barrier.before.layout == barrier.after.layout and not barrier.discard
        needed = (bool(barrier.after.layout) and not stays) or "host" in barrier.after.stages
        return bool(since) and not needed and all(self.orders(step, last) for last in since.values())

    def extend_waits(self, step: int, since: Mapping[str, int], stages: frozenset[str]) -> None:
        """Add the stages of a redundant barrier to the waits that replace it."""
        for last in since.values():
            if self.orders(step, last):
                self._clocks.extend(self._place(last), step + 1, stages)

    def _place(self, since: int) -> int:
        frames, step = divmod(since, len(self.queues) + 1)
        return step + 1 + frames * self._clocks.frame

    def aliased(
        self, users: Sequence[str], epochs: Mapping[str, Sequence[Behind]], step: int, first: Touch
    ) -> tuple[list[Behind], frozenset[str]]:
        """Return the earlier users of a transient's memory, out of `users`, that its barrier waits for on its queue.

        Also returns the source stages of an image's barrier after users on other queues: the stages of the waits that
        order those users before it.
        """
        own: list[Behind] = []
        waited = False
        for user in users:
            for behind in self._last(user, epochs):
                since = behind.last if behind.last < step else behind.last - len(self.queues) - 1
                if self.queue(behind.last) != self.queues[step]:
                    waited = True
                elif first.layout or not self.orders(step, since):
                    own.append(behind)
                    continue
                self._clocks.extend(self._place(since), step + 1, first.stages)
        return own, first.stages if waited and first.layout else frozenset()

    def _last(self, user: str, epochs: Mapping[str, Sequence[Behind]]) -> Sequence[Behind]:
        """Return the parts of the last epoch of a transient."""
        if user not in self._chains:
            return epochs[user][-1:]
        return [part.behind() for part in self._chains[user].epochs[-1].values()]

    def batches(self, epilogue: bool) -> tuple[Batch, ...]:
        """Return the batches in the order of submission."""
        return self._clocks.batches(epilogue)


def _since(place: int, after: int, frame: int) -> int:
    """Return a place as a step number relative to the frame of place `after`: below 0 for earlier frames."""
    frames = place // frame - after // frame
    return place % frame - 1 + frames * (frame - 1)


class _Chain:
    """The epochs of one resource, over one frame or, for a history, over two."""

    def __init__(
        self,
        name: str,
        uses: Sequence[tuple[int, str, Touch]],
        resource: Resource,
        external: External | None,
        frame: int,
        plan: Planned,
    ) -> None:
        self._name, self._life, self._frame, self._plan = name, resource.life, frame, plan
        self._image = resource.kind != "buffer"
        self._exclusive = self._image and external is None
        self._external = external
        leaves = external.leaves if external is not None else None
        if leaves is not None and (leaves.stages or leaves.layout != uses[-1][2].layout):
            uses = [*uses, (frame - 1, GRAPHICS, leaves)]  # the owner uses it after the frame
        self._uses = uses
        self._turn = frame * (1 + (uses[-1][0] >= frame))
        self.epochs = self._cut(uses)
        self._written = _head(self.epochs[0]).first

    def _cut(self, uses: Sequence[tuple[int, str, Touch]]) -> list[Epoch]:
        epochs: list[Epoch] = []
        for place, queue, touch in uses:
            ends = dict.fromkeys(touch.stages, place)
            last: Epoch = epochs[-1] if epochs else {}
            combined = [merged(part.touch, touch) for part in last.values()]
            if (
                not last
                or (self._exclusive and queue not in last)
                or any(touch is None or touch.writes for touch in combined)
            ):
                epochs.append({queue: Part(place, ends, touch)})
            elif queue in last:
                old = last[queue]
                last[queue] = Part(old.first, {**old.ends, **ends}, merged(old.touch, touch) or touch)
            else:
                last[queue] = Part(place, ends, touch)
        return epochs

    def follow(self) -> None:
        """Plan the resource from its first epoch to the first epoch of the next frame."""
        ready = self._external is not None and self._enter(self._external)
        for before, after in pairwise(self.epochs):
            ready &= not _writes(before) and _layout(before) == _layout(after)
            self._pass_on(before, after, ready=ready)
            if _writes(after) or _layout(before) != _layout(after):
                self._written = _head(after).first
        if self._external is not None:
            return
        first, last = self.epochs[0], self.epochs[-1]
        again = {queue: part.later(self._turn) for queue, part in first.items()}
        if self._life == "transient":  # the previous user of its memory is not planned yet
            for queue, part in again.items():
                self._cross(last, queue, part)
        else:
            self._pass_on(last, again, discard=True)
        if self._image and self._turn > self._frame:
            self._begin()

    def _cross(self, before: Epoch, queue: str, part: Part) -> None:
        """Add crossings from the parts of an epoch on other queues to a part."""
        for other, old in before.items():
            if other != queue:
                self._plan.crossings.append(Crossing(old.last, part.first, _stages(before, part)))

    def _pass_on(self, before: Epoch, after: Epoch, discard: bool = False, ready: bool = False) -> None:
        """Plan barriers, crossings and transfers between two epochs."""
        changes = self._image and (discard or _layout(before) != _layout(after))
        head = _head(after)
        for queue, part in after.items():
            if changes and part is not head:
                # One reader performs the layout transition, and the other readers wait for it.
                self._plan.crossings.append(Crossing(head.first, part.first, part.touch.stages))
                continue
            self._cross(before, queue, part)
            if queue in before:
                own = before[queue]
                since = {stage: _since(place, part.first, self._frame) for stage, place in own.ends.items()}
                if not conflict(own.touch, part.touch) and not discard:
                    continue
                touch = own.touch
                if len(before) > 1 and (changes or _is_cpu(part)):
                    touch = replace(touch, stages=touch.stages | _stages(before, part))
                self._place(
                    Barrier(self._name_of(part.first), touch, part.touch, discard), part, since, ready
                )
            elif self._exclusive and not discard:
                ((other, own),) = before.items()
                barrier = Barrier(self._name_of(part.first), own.touch, part.touch, hand_over=(other, queue))
                self._place(barrier, part, {})
                released = replace(barrier, resource=self._name_of(own.last))
                self._plan.releases.setdefault(own.last % self._frame - 1, []).append(released)
            elif changes or _is_cpu(part):
                old = Touch("undefined" if discard else _layout(before), _stages(before, part), frozenset())
                self._place(Barrier(self._name_of(part.first), old, part.touch, discard), part, {})

    def _place(self, barrier: Barrier, part: Part, since: Mapping[str, int], ready: bool = False) -> None:
        self._plan.placed.append((barrier, part.first % self._frame - 1, since, ready, self._written))

    def _name_of(self, place: int) -> str:
        return self._name + PREVIOUS * (self._frame <= place % self._turn)

    # --- ends ---

    def _enter(self, external: External) -> bool:
        """Plan the first use of an external after its owner; return whether its contents are visible to all readers."""
        first, enters = self.epochs[0], external.enters
        if not enters.stages:
            if self._image and enters.layout != _layout(first):
                head = _head(first)
                self._place(Barrier(self._name, enters, head.touch), head, {})
                for part in first.values():
                    if part is not head:
                        self._plan.crossings.append(Crossing(head.first, part.first, part.touch.stages))
            return enters == replace(UNTOUCHED, layout=_layout(first))
        owner = {GRAPHICS: Part(0, dict.fromkeys(enters.stages, 0), enters)}
        if not _writes(first) and enters.layout == _layout(first):
            self._written = 0
        own = first.get(GRAPHICS)
        if own is not None and covers(enters, own.touch):
            # No barrier before the first use: later barriers wait for the owner's use, too.
            first[GRAPHICS] = Part(
                own.first, {**owner[GRAPHICS].ends, **own.ends}, merged(enters, own.touch) or enters
            )
            for queue, part in first.items():
                self._cross(owner, queue, part)
        elif own is not None and not conflict(enters, own.touch):
            late = [
                use
                for use in self._uses
                if use[1] == GRAPHICS and use[0] <= own.last and not covers(enters, use[2])
            ]
            seen = Part(late[0][0], {}, reduce(_combined, (touch for _, _, touch in late)))
            self._place(Barrier(self._name, enters, seen.touch), seen, dict.fromkeys(enters.stages, -1))
            for queue, part in first.items():
                self._cross(owner, queue, part)
        else:
            self._pass_on(owner, first)
        return False

    def _begin(self) -> None:
        """Plan the prologue of a history: the state and the queue that each frame expects."""
        number = max(i for i, epoch in enumerate(self.epochs) if _head(epoch).first < self._frame)
        ((queue, part),) = self.epochs[number].items()
        name = self._name + PREVIOUS
        on = None if queue == GRAPHICS else (queue, queue)
        self._plan.prologue.append(Barrier(name, UNTOUCHED, part.touch, discard=True, hand_over=on))
        if part.last < self._frame:
            ((other, after),) = self.epochs[number + 1].items()
            if other != queue:
                self._plan.prologue.append(Barrier(name, part.touch, after.touch, hand_over=(queue, other)))


def _head(epoch: Epoch) -> Part:
    """Return the part that begins first, which performs layout transitions. Parts are ordered by their first step."""
    return next(iter(epoch.values()))


def _layout(epoch: Epoch) -> str:
    return _head(epoch).touch.layout


def _writes(epoch: Epoch) -> bool:
    return any(part.touch.writes for part in epoch.values())


def _combined(first: Touch, second: Touch) -> Touch:
    return cast(Touch, merged(first, second))  # an epoch has one layout


def _is_cpu(part: Part) -> bool:
    """Whether the owner reads on the CPU: a semaphore wait makes nothing visible to the CPU."""
    return "host" in part.touch.stages


def _stages(before: Epoch, part: Part) -> frozenset[str]:
    """Return the stages at which a part waits for another queue; for the CPU, the stages of the earlier epoch."""
    own = part.touch.stages - {"host"}
    return own or frozenset().union(*(part.touch.stages for part in before.values()))
