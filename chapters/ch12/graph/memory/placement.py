"""Placement of the transients of a frame in memory: resources with disjoint lifetimes share it.

A transient lives from the first to the last step that uses it. Two with overlapping lives get different bytes. All
others may share bytes, whatever their sizes and formats. Barriers order the steps of a queue, and the first barrier of
each resource waits for the previous users of its bytes.

Resources are placed from the largest to the smallest, each at the lowest offset where it overlaps no placed resource
that is alive at the same time. This is a heuristic (the problem, "dynamic storage allocation", is NP-hard).
`Memory.bound` is a lower bound, and a test compares the two.
"""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from collections import defaultdict
from collections.abc import Callable, Collection, Mapping, Sequence
from operator import itemgetter

import numpy as np

from ..types import Heap, Memory, Place, Requirement

Life = tuple[int, int]


def place_transients(
    lives: Mapping[str, Life],
    needs: Mapping[str, Requirement],
    buffers: Collection[str] = (),
    alias: bool = True,
    apart: Callable[[Mapping[str, Life]], np.ndarray] | None = None,
) -> Memory:
    """Give every resource in `lives` a place in a heap of its kind.

    `lives` has the numbers of the first and the last step of each. Images and buffers, and resources with different
    memory types, lie in different heaps. Without `alias` no two share a byte. With several queues `apart`
    returns (lives, lives) bool: the pairs that cannot share.
    """
    kinds: dict[tuple[int, bool], list[str]] = defaultdict(list)
    for name in lives:
        kinds[needs[name].types, name in buffers].append(name)
    places: dict[str, Place] = {}
    heaps: list[Heap] = []
    bound = 0
    for (types, _), names in sorted(kinds.items()):
        largest = sorted(names, key=lambda name: (-needs[name].size, name))
        together = np.ones((len(names),) * 2, bool)
        if alias:
            together = (apart or _together)({name: lives[name] for name in largest})
        ranges: list[tuple[int, int]] = []
        for name, near in zip(largest, together, strict=True):
            offset = _lowest(needs[name], [ranges[other] for other in np.flatnonzero(near[: len(ranges)])])
            ranges.append((offset, needs[name].size))
        offsets = {name: offset for name, (offset, _) in zip(largest, ranges, strict=True)}
        size = max(offset + size for offset, size in ranges)
        for name in names:
            places[name] = Place(len(heaps), offsets[name], needs[name].size, needs[name].padding)
        heaps.append(Heap(size, types, max(needs[name].alignment for name in names)))
        bound += _most_alive({name: lives[name] for name in names}, needs)
    alone = sum(needs[name].size for name in lives)
    return Memory(dict(lives), places, tuple(heaps), alone, bound)


def _together(lives: Mapping[str, Life]) -> np.ndarray:
    """Return (lives, lives) bool: the pairs that have a step in common."""
    first, last = np.array([*lives.values()]).T
    return (first[:, None] <= last) & (first <= last[:, None])


def _lowest(need: Requirement, ranges: Sequence[tuple[int, int]]) -> int:
    """Return the lowest aligned offset at which `need` fits beside `ranges` of (offset, size)."""
    offset = 0
    for start, size in sorted(ranges):
        if offset + need.size <= start:
            break
        offset = max(offset, -(-(start + size) // need.alignment) * need.alignment)
    return offset


def _most_alive(lives: Mapping[str, Life], needs: Mapping[str, Requirement]) -> int:
    """Return the most bytes that are alive in one step."""
    change: dict[int, int] = defaultdict(int)
    for name, (first, last) in lives.items():
        change[first] += needs[name].size
        change[last + 1] -= needs[name].size
    most = now = 0
    for step in sorted(change):
        now += change[step]
        most = max(most, now)
    return most


def users_before(memory: Memory) -> dict[str, list[str]]:
    """Return for each transient the last users of its bytes before its life begins: its first use waits for them.

    A transient that shares no memory is its own last user, in the previous frame. A resource whose bytes all have later
    users is left out: those users waited for it.

    That is a chain of barriers, and by the specification it orders all accesses. But synchronization validation follows
    a chain only over the bytes of texels, without padding. So the last users of texels are included as well.
    """
    users = _users(memory, {name: place.size for name, place in memory.places.items()})
    if any(place.padding for place in memory.places.values()):
        texels = {name: place.size - place.padding for name, place in memory.places.items()}
        of_texels = _users(memory, texels)
        users = {name: sorted({*users[name], *of_texels[name]}) for name in users}
    return users


def _users(memory: Memory, sizes: Mapping[str, int]) -> dict[str, list[str]]:
    """Return the last users of the bytes of each transient if a use takes `sizes` bytes from the offset on."""
    # By heap, ordered by place: (begin, end, last user of these bytes).
    owners: list[list[tuple[int, int, str]]] = [[] for _ in memory.heaps]
    users: dict[str, list[str]] = {}
    order = sorted(memory.lives, key=lambda name: memory.lives[name])
    for name in (*order, *order):  # the first round is the previous frame
        place = memory.places[name]
        begin, end = place.offset, place.offset + sizes[name]
        ranges = owners[place.heap]
        since = bisect_right(ranges, begin, key=itemgetter(1))
        until = bisect_left(ranges, end, since, key=itemgetter(0))
        overlapped = ranges[since:until]
        before = [(low, begin, user) for low, _, user in overlapped[:1] if low < begin]
        behind = [(end, high, user) for _, high, user in overlapped[-1:] if end < high]
        ranges[since:until] = [*before, (begin, end, name), *behind]
        users[name] = sorted({user for _, _, user in overlapped})
    return users
