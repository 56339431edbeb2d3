"""In which order the passes of a frame run: one that every edge allows, always the same, with few changes of layout.

Kahn's algorithm: a pass is ready when all before it are placed. Of several that are ready, the one comes first that
finds most of what it touches in the layout it needs; among equals the name decides, so the order in which passes were
declared does not show. A pass is looked at again only when something that it touches changed its layout: so a thousand
passes take about fifty times as long as twenty.
"""

from __future__ import annotations

import heapq
from collections import Counter, defaultdict
from collections.abc import Mapping, Sequence

from .types import Edge, GraphError


def order(names: Sequence[str], edges: Sequence[Edge], layouts: Mapping[str, Mapping[str, str]]) -> list[str]:
    """Return the names in an order that all edges allow.

    `layouts` says by pass and resource in which layout it needs it; a resource that nobody has touched is in none.
    Raises GraphError with the path of names where passes wait for each other in a circle.
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

    def cost(name: str) -> int:
        return sum(now.get(resource) != layout for resource, layout in layouts[name].items())

    heap = [(cost(name), name) for name in ready]
    heapq.heapify(heap)
    found = []
    while heap:
        was, name = heapq.heappop(heap)
        if name not in ready or was != cost(name):
            continue  # an older look at it: a newer one is in the heap
        ready.discard(name)
        found.append(name)
        woken = set()
        for resource, layout in layouts[name].items():
            if now.get(resource) != layout:
                now[resource] = layout
                woken.update(ready.intersection(users[resource]))
        for follower in after[name]:
            waits[follower] -= 1
            if not waits[follower]:
                ready.add(follower)
                woken.add(follower)
        for other in woken:
            heapq.heappush(heap, (cost(other), other))
    if len(found) < len(names):
        raise GraphError(_circle(set(names).difference(found), edges))
    return found


def _circle(stuck: set[str], edges: Sequence[Edge]) -> str:
    """Return the sentence about a circle among the passes that never became ready: each of them waits for another."""
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
