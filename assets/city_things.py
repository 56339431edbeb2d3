"""What a city draws many times: trees, cars, and the furniture of streets and roofs, in a finish for its size."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from assets.city_cars import COLORS, MODELS, TAXI, car
from assets.city_fittings import OUTDOORS, ROOF
from assets.city_furniture import STREET
from assets.city_parts import Parts
from assets.city_trees import KINDS, conifer, leafy_tree, tree

BUS = (0.55, 0.04, 0.03)


@dataclass(frozen=True)
class Finish:
    """How finely things are made.

    `around` is the number of steps around a turned thing, `cards` that of a crown, `stations` a quarter of those along
    a car. `cars` and `trees` are numbers of variants, and `level` is the ornament of landmarks. A small city has only
    `kinds` of things, another one all of them.
    """

    around: int
    cards: int
    stations: int
    cars: int
    trees: int
    level: int
    kinds: tuple[str, ...] = ()


FEW = ("lamp", "bench", "bin", "hydrant", "bollard", "planter", "tree lime", "tree plane", "car")
FINISHES = {
    900_000: Finish(16, 260, 5, 24, 3, 3),
    300_000: Finish(12, 200, 3, 12, 2, 1),
    80_000: Finish(8, 150, 2, 6, 1, 0),
    0: Finish(5, 30, 1, 1, 1, 0, FEW),
}
"""By the number of unique triangles from which on a city has it."""


def finish_of(triangles: int) -> Finish:
    """Return the finish of a city of so many unique triangles."""
    return next(finish for least, finish in FINISHES.items() if triangles >= least)


def all_things(finish: Finish) -> dict[str, list[Parts]]:
    """Return the variants of each kind of thing."""
    rng, n = np.random.default_rng(1301), finish.around
    things = {kind: [make(n)] for kind, make in {**STREET, **OUTDOORS, **ROOF}.items()}
    for kind in KINDS:
        cards = [tree(kind, max(5, n // 2), finish.cards, rng) for _ in range(min(finish.trees, 2))]
        leafy = [leafy_tree(kind, 20 * finish.cards, rng) for _ in range(finish.trees - len(cards))]
        things[f"tree {kind.name}"] = cards + leafy
    things["tree conifer"] = [conifer(2 * n, 4 + n // 4, rng) for _ in range(finish.trees)]
    things["car"] = []
    for k in range(finish.cars):
        taxi = k % 8 == 4
        color = TAXI if taxi else COLORS[k % len(COLORS)]
        stations = finish.stations + (k % 2 if finish.stations > 3 else 0)
        model = MODELS[k % 4]
        long, wide = rng.uniform(0.97, 1.03, 2)
        model = replace(model, length=long * model.length, width=wide * model.width)
        things["car"].append(car(model, color, stations, taxi))
    things["bus"] = [car(MODELS[4], BUS, finish.stations + 1)]
    return {kind: variants for kind, variants in things.items() if not finish.kinds or kind in finish.kinds}
