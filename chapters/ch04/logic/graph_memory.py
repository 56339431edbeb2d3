"""Where the transients of a frame lie: resources that are never alive at the same time share memory.

A transient lives from the first to the last step that uses it. Two whose lives overlap get bytes of their own; all
others may get the same ones, whatever their size and format. Steps on one queue run one after another, as far as
barriers say so, and the first barrier of each resource waits for whoever used its bytes before.

Largest first, each at the lowest offset at which it fits between those that live at the same time and have their place
already. That is a heuristic (the problem, "dynamic storage allocation", is NP-hard); `Memory.bound` is what not even
the best arrangement can go below, and a test holds the two beside each other.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Collection, Iterable, Mapping

from .graph_types import Heap, Memory, Place, Requirement

Life = tuple[int, int]


def place_transients(
    lives: Mapping[str, Life],
    needs: Mapping[str, Requirement],
    buffers: Collection[str] = (),
    alias: bool = True,
) -> Memory:
    """Give every resource in `lives` a place in a heap of its kind.

    `lives` are the numbers of the first and last step that use it. Images and buffers, and resources whose memory may
    be of other types, lie in different heaps. Without `alias` no two share a byte.
    """
    kinds: dict[tuple[int, bool], list[str]] = defaultdict(list)
    for name in lives:
        kinds[needs[name].types, name in buffers].append(name)
    places: dict[str, Place] = {}
    heaps: list[Heap] = []
    bound = 0
    for (types, _), names in sorted(kinds.items()):
        together = _together({name: lives[name] for name in names}) if alias else {}
        offsets: dict[str, int] = {}
        for name in sorted(names, key=lambda name: (-needs[name].size, name)):
            others = [other for other in (together[name] if alias else offsets) if other in offsets]
            offsets[name] = _lowest(needs[name], ((offsets[other], needs[other].size) for other in others))
        size = max(offsets[name] + needs[name].size for name in names)
        for name in names:
            places[name] = Place(len(heaps), offsets[name], needs[name].size)
        heaps.append(Heap(size, types, max(needs[name].alignment for name in names)))
        bound += _most_alive({name: lives[name] for name in names}, needs)
    alone = sum(needs[name].size for name in lives)
    return Memory(dict(lives), places, tuple(heaps), alone, bound)


def _together(lives: Mapping[str, Life]) -> dict[str, list[str]]:
    """Return for each resource those that live at the same time as it."""
    together: dict[str, list[str]] = {name: [] for name in lives}
    alive: list[str] = []
    for name in sorted(lives, key=lambda name: lives[name]):
        first = lives[name][0]
        alive = [other for other in alive if lives[other][1] >= first]
        for other in alive:
            together[name].append(other)
            together[other].append(name)
        alive.append(name)
    return together


def _lowest(need: Requirement, taken: Iterable[tuple[int, int]]) -> int:
    """Return the lowest aligned offset at which `need` fits beside ranges (offset, size) that are taken."""
    offset = 0
    for start, size in sorted(taken):
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
    """Return for each transient who used its bytes last before its life begins: what its first use has to wait for.

    It is itself where it shares with nobody, and the frame before it was whoever is last in the frame. Somebody whose
    bytes others have all taken over since is not named: they waited for it.
    """
    owners: list[list[tuple[int, int, str]]] = [[] for _ in memory.heaps]  # (begin, end, who used them last)
    found: dict[str, list[str]] = {}
    order = sorted(memory.lives, key=lambda name: memory.lives[name])
    for name in (*order, *order):  # the first turn is the frame before
        place = memory.places[name]
        begin, end = place.offset, place.offset + place.size
        rest = []
        users = []
        for low, high, user in owners[place.heap]:
            if high <= begin or end <= low:
                rest.append((low, high, user))
                continue
            users.append(user)
            rest += [(low, begin, user)] * (low < begin) + [(end, high, user)] * (end < high)
        owners[place.heap] = [*rest, (begin, end, name)]
        found[name] = list(dict.fromkeys(users))
    return found
