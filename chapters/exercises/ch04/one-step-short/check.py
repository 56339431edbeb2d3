"""Places in memory of resources whose lives are known: those that are alive together share no bytes, and others do."""

from __future__ import annotations

import random
from itertools import combinations
from typing import Any

from tools.exercises.checking import Given

UNIT = 256


def check(given: Given) -> None:
    """A chain of passes, and lives at random."""
    memory: Any = given.module("graph.memory.placement")
    need = given.module("graph.types").Requirement
    chain = {"first": (0, 1), "second": (1, 2), "third": (2, 3)}
    _hold(given, memory, need, chain, dict.fromkeys(chain, UNIT))
    size = memory.place_transients(chain, dict.fromkeys(chain, need(UNIT))).size
    given.need(
        size == 2 * UNIT,
        f"In a chain two images are alive at a time, and 'first' and 'third' never together: {2 * UNIT} bytes do, "
        f"and {size} are taken.",
    )
    rng = random.Random(4)
    for _ in range(100):
        lives = {}
        for number in range(8):
            first = rng.randrange(6)
            lives[f"image {number}"] = (first, rng.randint(first, 6))
        _hold(given, memory, need, lives, {name: UNIT * rng.randint(1, 4) for name in lives})


def _hold(
    given: Given, memory: Any, need: Any, lives: dict[str, tuple[int, int]], sizes: dict[str, int]
) -> None:
    places = memory.place_transients(lives, {name: need(size) for name, size in sizes.items()}).places
    for one, other in combinations(lives, 2):
        step = max(lives[one][0], lives[other][0])
        together = step <= min(lives[one][1], lives[other][1])
        low, high = sorted((places[one], places[other]), key=lambda place: place.offset)
        given.need(
            not together or low.offset + low.size <= high.offset,
            f"Step {step} uses both '{one}' (steps {lives[one][0]} to {lives[one][1]}) and '{other}' "
            f"({lives[other][0]} to {lives[other][1]}), and they share bytes.",
        )
