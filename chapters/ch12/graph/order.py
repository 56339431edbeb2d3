"""The order of the passes of a frame: topological, deterministic, with few layout transitions.

Kahn's algorithm: a pass is ready when all its predecessors are placed. Of the ready passes, the one with the fewest
layout transitions comes first. Ties are broken by name, so the order of declaration has no effect. The cost of a
pass is computed again only when the layout of one of its resources changes. So a thousand passes take about fifty
times as long as twenty.
"""

from __future__ import annotations

import heapq
from collections import Counter, defaultdict
from collections.abc import Mapping, Sequence

from .sync.queues import Eager
from .types import Edge, GraphError

Layouts = Mapping[str, Mapping[str, str]]


def order(
    names: Sequence[str], edges: Sequence[Edge], layouts: Layouts, eager: Eager | None = None
) -> list[str]:
    """Return the names in a topological order.

    `layouts` has the required layout by pass and resource; before its first use a resource has no layout.
    With several queues, `eager` ranks the ready passes; layout transitions break ties.
    Raises GraphError with the names along the cycle if the edges form one.
    """
    after: dict[str, set[str]] = defaultdict(set)
    for edge in edges:
        after[edge.before].add(edge.after)
    waits = Counter(name for followers in after.values() for name in followers)
    users: dict[str, list[str]] = defaultdict(list)
    for name in names:
        for resource in layouts[name]:
            users[resource].append(name)
    now: dict[str, str] = {}
    ready = {name for name in names if not waits[name]}

    def cost(name: str) -> tuple[tuple[bool, int, int] | None, int]:
        changed = sum(now.get(resource) != layout for resource, layout in layouts[name].items())
        return eager.rank(name) if eager else None, changed

    heap = [(cost(name), name) for name in ready]
    heapq.heapify(heap)
    ordered = []
    while heap:
        queued, name = heapq.heappop(heap)
        if name not in ready or queued != cost(name):
            continue  # an outdated cost: the heap has a newer one
        ready.discard(name)
        ordered.append(name)
        updated = {*ready} if eager and eager.place(name) else set()
        for resource, layout in layouts[name].items():
            if now.get(resource) != layout:
                now[resource] = layout
                updated.update(ready.intersection(users[resource]))
        for follower in after[name]:
            waits[follower] -= 1
            if not waits[follower]:
                ready.add(follower)
                updated.add(follower)
        for other in updated:
            heapq.heappush(heap, (cost(other), other))
    if len(ordered) < len(names):
        raise GraphError(_circle(set(names).difference(ordered), edges))
    return ordered


def _circle(stuck: set[str], edges: Sequence[Edge]) -> str:
    """Return the sentence about a cycle among the passes that never became ready."""
    before = {edge.after: edge for edge in edges if edge.before in stuck and edge.after in stuck}
    name, path = min(before), []
    while name not in path:
        path.append(name)
        name = before[name].before
    circle = [*path[path.index(name) :], name][::-1]
    links = [f"'{circle[0]}'"]
    for later in circle[1:]:
        links.append(f"'{later}' (which {before[later].why} '{before[later].name}')")
    return f"The passes wait for each other in a circle: {' -> '.join(links)}."
