"""Springs of sheets, of stars and by lot: two of one colour share no particle, and there are not many colours."""

from __future__ import annotations

import random
from collections import Counter
from collections.abc import Sequence
from typing import Any

import numpy as np

from tests.support.cloths import sheet
from tools.exercises.checking import Given

Pair = tuple[int, int]

SMALL = {
    "a path": ((0, 1), (1, 2), (2, 3)),
    "a path from its other end": ((3, 2), (2, 1), (1, 0)),
    "a triangle": ((0, 1), (1, 2), (2, 0)),
    "two springs whose second particle is the same": ((0, 2), (1, 2)),
    "two springs whose first particle is the same": ((0, 1), (0, 2)),
}


def check(given: Given) -> None:
    """Small cases by name, a star with more springs than a number has bits, a sheet, and pairs drawn by lot."""
    for what, springs in SMALL.items():
        _hold(given, what, springs)
    _hold(given, "a star of 100 springs", [(0, number + 1) for number in range(100)])
    cloth = sheet(given.module("cloth.build").build_cloth, 9, 7)
    _hold(given, "a sheet of 9 x 7 particles", [(int(a), int(b)) for a, b in cloth.springs])
    rng = random.Random(5)
    for _ in range(50):
        count = rng.randint(2, 12)
        pairs = [rng.sample(range(count), 2) for _ in range(rng.randint(1, 30))]
        _hold(given, "springs drawn by lot", [(a, b) for a, b in pairs])


def _hold(given: Given, what: str, springs: Sequence[Pair]) -> None:
    find: Any = given.module("cloth.model").color_springs
    particles = 1 + max(max(pair) for pair in springs)
    colors = np.asarray(find(np.array(springs), particles)).tolist()
    given.need(
        len(colors) == len(springs) and min(colors) >= 0,
        f"In {what}, each of {len(springs)} springs has to have a colour from 0 on: {colors[:8]}.",
    )
    taken: dict[Pair, Pair] = {}
    for pair, color in zip(springs, colors, strict=True):
        for end in pair:
            other = taken.setdefault((end, color), pair)
            given.need(
                other is pair,
                f"In {what}, the springs {other} and {pair} both have colour {color}, and both move particle {end}.",
            )
    busiest = max(Counter(end for pair in springs for end in pair).values())
    used = max(colors) + 1
    given.need(
        used <= 2 * busiest - 1,
        f"In {what}, no particle has more than {busiest} springs, and there are {used} colours: each is a stage for "
        f"which all wait, and {2 * busiest - 1} are enough.",
    )
