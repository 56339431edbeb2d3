"""Orders of graphs: allowed by every edge, the same however the passes are named first, with few bytes alive."""

from __future__ import annotations

import random
from collections.abc import Mapping, Sequence
from typing import Any

from tools.exercises.checking import Given

Uses = Mapping[str, Mapping[str, int]]

BRANCHES: Uses = {
    "begin left": {"wide left": 8},
    "begin right": {"wide right": 8},
    "end left": {"wide left": 8, "small left": 1},
    "end right": {"wide right": 8, "small right": 1},
    "merge": {"small left": 1, "small right": 1, "picture": 2},
}
BEFORE = {"end left": ("begin left",), "end right": ("begin right",), "merge": ("end left", "end right")}


def check(given: Given) -> None:
    """Two branches, a graph without passes, and graphs at random."""
    found: Any = getattr(given.module("graph.order_bytes"), "order_by_bytes", None)
    given.need(callable(found), "graph/order_bytes.py has no function order_by_bytes yet.")
    edge = given.module("graph.types").Edge

    def answer(names: Sequence[str], before: Mapping[str, Sequence[str]], uses: Uses) -> list[str]:
        edges = [edge(one, name, "", "reads") for name in names for one in before.get(name, ())]
        return list(found(names, [*edges, *edges], uses))

    given.need(answer([], {}, {}) == [], "A graph without passes has an order.")
    order = answer(list(BRANCHES), BEFORE, BRANCHES)
    given.need(
        order == ["begin left", "end left", "begin right", "end right", "merge"],
        f"One branch has to be over before the other begins, so that one wide image is alive: {', '.join(order)}.",
    )
    rng = random.Random(4)
    for _ in range(40):
        names = [f"p{number}" for number in range(9)]
        before = {
            name: [one for one in names[:number] if rng.random() < 0.25] for number, name in enumerate(names)
        }
        images = {f"i{number}": rng.randint(1, 9) for number in range(7)}
        uses = {name: {one: images[one] for one in rng.sample(sorted(images), 2)} for name in names}
        order = answer(rng.sample(names, len(names)), before, uses)
        given.need(sorted(order) == names, "Each pass has to be in the order once.")
        late = next(
            (name for name in names for one in before[name] if order.index(one) > order.index(name)), None
        )
        given.need(late is None, f"'{late}' runs before a pass that it comes after.")
        wanted = _by_trying(names, before, uses)
        given.need(
            order == wanted,
            f"Along {', '.join(wanted)} fewer bytes are alive than along {', '.join(order)}, or as many, and then the "
            "name decides.",
        )


def _by_trying(names: Sequence[str], before: Mapping[str, Sequence[str]], uses: Uses) -> list[str]:
    order: list[str] = []
    while len(order) < len(names):
        ready = [name for name in names if name not in order and all(one in order for one in before[name])]
        order.append(min(ready, key=lambda name: (_alive([*order, name], names, uses), name)))
    return order


def _alive(done: Sequence[str], names: Sequence[str], uses: Uses) -> int:
    """Return the bytes of what passes that ran have touched and others still will."""
    touched = {one: size for name in done for one, size in uses[name].items()}
    still = {one for name in names if name not in done for one in uses[name]}
    return sum(size for one, size in touched.items() if one in still)
