"""Where street furniture, trees, cars and roof fittings may stand, and which of these places are taken.

There are more places than a city of a given size has instances for. Each has a rank, and those of least rank are taken
until the number of instances is exactly what it should be.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from assets.city_plan import BLOCK, KERB, PAVEMENT, Block, Plan
from assets.city_roofs import PARAPET
from assets.noise import Float64

STREET_TREES = ("plane", "lime", "maple", "cherry")


@dataclass(frozen=True)
class Place:
    """A place for one thing of a `kind`: position, turn about y in degrees, and scale, negative where mirrored.

    `lean` is by how many degrees it leans below a stretched parent, which shears it; 0 stands upright.
    """

    rank: float
    kind: str
    at: tuple[float, float, float]
    turn: float = 0.0
    scale: tuple[float, float, float] = (1.0, 1.0, 1.0)
    lean: float = 0.0


class _Slots:
    """Collects places, each of a rank drawn between two bounds: what is wanted everywhere has low ones."""

    def __init__(self, rng: np.random.Generator) -> None:
        self.rng = rng
        self.places: list[Place] = []

    def put(
        self, kind: str, ranks: tuple[float, float], at: Sequence[float], turn: float = 0.0,
        scale: tuple[float, float, float] = (1.0, 1.0, 1.0), lean: float = 0.0,
    ) -> None:  # fmt: skip
        rank = float(self.rng.uniform(*ranks))
        self.places.append(Place(rank, kind, (float(at[0]), float(at[1]), float(at[2])), turn, scale, lean))

    def tree(
        self, kinds: Sequence[str], ranks: tuple[float, float], at: Sequence[float], lean: float = 0.0
    ) -> None:
        """Put a tree of one of the kinds, stretched a little, and mirrored in one case of three."""
        kind = kinds[int(self.rng.integers(len(kinds)))]
        wide, tall, mirrored = (
            self.rng.uniform(0.85, 1.15),
            self.rng.uniform(0.85, 1.2),
            self.rng.random() < 0.34,
        )
        self.put(
            f"tree {kind}", ranks, at, float(self.rng.uniform(0, 360)), (-wide if mirrored else wide, tall, wide), lean
        )  # fmt: skip


def all_places(plan: Plan, seed: int, eyes: Float64) -> list[Place]:
    """Return every place in the city, of least rank first; none is before the `eyes` (N, 3) of views."""
    slots = _Slots(np.random.default_rng(seed))
    for block in plan.blocks:
        _pavements(slots, plan, block)
        {"houses": _roofs, "square": _square, "park": _park, "tower": _plaza}[block.kind](slots, block)
    _edge(slots, plan)

    def is_free(place: Place) -> bool:
        away = {"bus": 8.0, "car": 4.5}.get(place.kind, 2.6)
        near = np.hypot(eyes[:, 0] - place.at[0], eyes[:, 2] - place.at[2]) < away
        return not (near & (np.abs(eyes[:, 1] - place.at[1]) < 6.0)).any()

    return sorted(filter(is_free, slots.places), key=lambda place: place.rank)


def _sides(block: Block) -> Iterator[tuple[int, float, Callable[[float, float], tuple[float, float]], float]]:
    """Yield number, length, a function and a turn for each side of a block.

    The function gives (x, z) of a point so far along the side and so far in front of the houses.
    """
    x, z, w, d = block.x, block.z, *BLOCK
    yield 0, w, lambda s, out: (x + s, z + d + out), 0.0
    yield 1, d, lambda s, out: (x + w + out, z + d - s), 90.0
    yield 2, w, lambda s, out: (x + w - s, z - out), 180.0
    yield 3, d, lambda s, out: (x - out, z + s), 270.0


def _pavements(slots: _Slots, plan: Plan, block: Block) -> None:
    """Line the four sides of a block: trees, lamps, furniture at the kerb and the walls, cars in the road."""
    rng, kerb = slots.rng, PAVEMENT - 0.75
    for number, length, at, turn in _sides(block):
        road = (
            plan.road_z[block.row + (number == 0)]
            if number % 2 == 0
            else plan.road_x[block.column + (number == 1)]
        )
        kinds = STREET_TREES[(block.row + block.column + number) % 4 :][:1] if road[1] < 10 else ("plane",)

        def ground(s: float, out: float, y: float = KERB) -> tuple[float, float, float]:
            x, z = at(s, out)  # noqa: B023 - used before the loop goes on
            return x, y, z

        for s in np.arange(6.0, length - 4, 9.0):
            slots.tree(kinds, (0.0, 0.6), ground(s, kerb))
            slots.put("grate", (0.3, 1.0), ground(s + 2.0, PAVEMENT + 3.4, 0.0))
            slots.put("bicycle", (0.35, 1.0), ground(s + 5.6, kerb - 0.1), turn + 90 + rng.uniform(-8, 8))
            slots.put("bollard", (0.3, 1.0), ground(s + 3.0, kerb + 0.3))
            slots.put("bollard", (0.3, 1.0), ground(s + 6.6, kerb + 0.3))
        for s in np.arange(1.5, length, 19.0):
            slots.put("lamp", (0.0, 0.4), ground(s, kerb + 0.15), turn)
            slots.put("bin", (0.1, 0.9), ground(s + 1.4, kerb), turn)
        for s in (length * 0.27, length * 0.62):
            slots.put("bench", (0.1, 0.8), ground(s, kerb - 0.2), turn + (180 if rng.random() < 0.5 else 0))
            slots.put("planter", (0.1, 0.9), ground(s + 3.0, 0.75))
            slots.put("planter", (0.1, 0.9), ground(s - 3.0, 0.75))
            slots.put("table", (0.2, 1.0), ground(s + 0.4, 1.6), float(rng.uniform(0, 180)))
            slots.put("table", (0.2, 1.0), ground(s - 2.0, 1.5), float(rng.uniform(0, 180)))
        slots.put("hydrant", (0.1, 0.7), ground(length * 0.45, kerb), turn)
        slots.put("sign", (0.1, 0.7), ground(length * 0.9, kerb + 0.2), turn + 90)
        slots.put("signal", (0.0, 0.6), ground(length + 1.2, kerb), turn + 90)
        if number % 2 == 0:
            slots.put("shelter", (0.1, 0.9), ground(length * 0.5 + 1.5, kerb - 0.6), turn)
            slots.put("column", (0.2, 1.0), ground(length * 0.8, kerb - 0.4))
            slots.put("kiosk", (0.3, 1.0), ground(length * 0.15 + 1.5, 1.6), turn)
        for _ in range(8):
            slots.put(
                "pigeon",
                (0.5, 1.0),
                ground(rng.uniform(0, length), rng.uniform(0.9, 3.0)),
                rng.uniform(0, 360),
            )
        _cars(slots, length, ground, turn, road[1])


def _cars(
    slots: _Slots, length: float, ground: Callable[[float, float, float], tuple[float, float, float]], turn: float,
    width: float,
) -> None:  # fmt: skip
    """Park cars along a side, and let some drive; they keep to the right."""
    rng, heading = slots.rng, turn - 90.0  # with the kerb to the right
    for s in np.arange(5.0, length - 4.0, 6.0):
        if rng.random() < 0.75:
            mirrored = rng.random() < 0.3
            scale = (-1.0 if mirrored else 1.0, 1.0, 1.0)
            at = ground(s + rng.uniform(-0.2, 0.2), PAVEMENT + 1.15, 0.0)
            slots.put("car", (0.0, 0.9), at, heading + rng.uniform(-2, 2), scale)
    lane = PAVEMENT + (3.3 if width < 10 else 4.3)
    s = rng.uniform(0, 12)
    while s < length:
        is_bus = width > 10 and rng.random() < 0.3
        slots.put("bus" if is_bus else "car", (0.1, 1.0), ground(s, lane, 0.0), heading)
        s += rng.uniform(14, 30)


def _roofs(slots: _Slots, block: Block) -> None:
    """Put tanks, coolers, pipes and masts on the decks of a block's houses, clear of their huts and skylights."""
    rng = slots.rng
    for lot in block.lots:
        if lot.roof != "flat" or lot.look == "works":
            continue
        y = KERB + lot.eave - PARAPET
        x0, z0 = block.x + lot.x, block.z + lot.z
        spots = [(0.2, 0.8), (0.8, 0.75), (0.82, 0.2), (0.16, 0.2)]
        kinds = [
            "tank" if rng.random() < 0.5 and lot.look in ("tenement", "slab") else "cooler",
            "cooler",
            "vent",
            "antenna",
        ]
        for (u, v), kind in zip(spots, kinds, strict=True):
            inside = 2.3 if kind == "tank" else 1.5
            x = x0 + np.clip(u * lot.width, inside, lot.width - inside)
            z = z0 + np.clip(v * lot.depth, inside, lot.depth - inside)
            turn = 90.0 * rng.integers(4)
            slots.put(kind, (0.0, 0.8), (x, y, z), turn)


def _in_block(block: Block, x: float, z: float) -> tuple[float, float, float]:
    return block.x + x, KERB, block.z + z


def _square(slots: _Slots, block: Block) -> None:
    """Furnish a square: a fountain, an obelisk, lanterns, trees in rows, tables, pigeons."""
    rng = slots.rng
    slots.put("fountain", (0, 0.01), _in_block(block, 30.0, 37.5))
    slots.put("monument", (0, 0.01), _in_block(block, 30.0, 6.5))
    for x in np.arange(4.0, 58.0, 7.4):
        for z in (2.0, 42.0):
            if abs(x - 30) > 4:
                slots.tree(("lime",), (0.0, 0.5), _in_block(block, x, z))
            slots.put("lantern", (0.0, 0.5), _in_block(block, x + 3.7, z))
    for x in (10.0, 18.0, 42.0, 50.0):
        for z, turn in ((4.0, 0.0), (40.0, 180.0)):
            slots.put("bench", (0.0, 0.5), _in_block(block, x, z), turn)
            slots.put("bin", (0.0, 0.6), _in_block(block, x + 1.8, z))
    for x in np.arange(5.0, 57.0, 4.2):
        for z in (9.5, 34.5):
            if abs(x - 30) > 6:
                slots.put(
                    "table", (0.1, 0.7), _in_block(block, x, z + rng.uniform(-0.6, 0.6)), rng.uniform(0, 180)
                )
    for _ in range(60):
        x, z = rng.uniform(3, 57), float(rng.choice([rng.uniform(3, 11), rng.uniform(33, 41)]))
        slots.put("pigeon", (0.1, 0.9), _in_block(block, x, z), rng.uniform(0, 360))


def _park(slots: _Slots, block: Block) -> None:
    """Furnish a park: a fountain, benches and lanterns on the paths, hedges, firs, trees that lean from the wind."""
    rng = slots.rng
    slots.put("fountain", (0, 0.01), _in_block(block, 30.0, 22.0))
    for x0, x1, z0, z1 in (
        (2.5, 28.5, 2.5, 20.5),
        (31.5, 57.5, 2.5, 20.5),
        (2.5, 28.5, 23.5, 41.5),
        (31.5, 57.5, 23.5, 41.5),
    ):
        for k in range(6):
            at = _in_block(
                block, x0 + (x1 - x0) * (0.16 + 0.34 * (k % 3)), z0 + (z1 - z0) * (0.25 + 0.5 * (k // 3))
            )
            if math.hypot(at[0] - block.x - 30, at[2] - block.z - 22) < 9:
                continue
            if k % 3 == 1:
                slots.tree(("conifer",), (0.0, 0.15), at)
            else:
                slots.tree(
                    ("plane", "maple", "poplar", "cherry"), (0.0, 0.5), at, lean=float(rng.uniform(4, 11))
                )
        for x in np.arange(x0 + 2.0, x1 - 1.0, 2.0):
            z = z0 + 0.6 if z0 < 20 else z1 - 0.6
            slots.put("hedge", (0.0, 0.3), _in_block(block, x, z))
    for x in (8.0, 18.0, 42.0, 52.0):
        for z, turn in ((20.9, 0.0), (23.1, 180.0)):
            slots.put("bench", (0.0, 0.5), _in_block(block, x, z), turn)
            slots.put("lantern", (0.0, 0.5), _in_block(block, x + 3.0, z))
    for _ in range(25):
        slots.put(
            "pigeon",
            (0.2, 0.9),
            _in_block(block, rng.uniform(25, 35), rng.uniform(16.5, 18.5)),
            rng.uniform(0, 360),
        )


def _plaza(slots: _Slots, block: Block) -> None:
    """Furnish the plaza around a tower."""
    rng = slots.rng
    for x in np.arange(4.0, 58.0, 6.5):
        for z in (4.0, 40.0):
            slots.tree(("cherry", "conifer"), (0.0, 0.5), _in_block(block, x, z))
            slots.put("bollard", (0.2, 0.9), _in_block(block, x + 2.0, 0.6 if z < 22 else 43.4))
    for x in (7.0, 12.0, 48.0, 53.0):
        for z in (12.0, 22.0, 32.0):
            slots.put(
                "bench" if z == 22 else "planter", (0.0, 0.6), _in_block(block, x, z), 90.0 * rng.integers(4)
            )
            slots.put("lantern", (0.1, 0.7), _in_block(block, x + 1.6, z + 3.0))


def _edge(slots: _Slots, plan: Plan) -> None:
    """Put a row of trees along the outside of the outer streets, where the city ends; some lean from the wind."""
    hx, hz = plan.half + 3.0
    kinds = ("poplar", "lime", "plane")

    def lean() -> float:
        return float(slots.rng.uniform(4, 11)) if slots.rng.random() < 0.3 else 0.0

    for t in np.arange(-hx, hx, 8.5):
        for z in (-hz, hz):
            slots.tree(kinds, (0.0, 0.6), (t + slots.rng.uniform(-1.5, 1.5), -0.03, z), lean())
    for t in np.arange(-hz, hz, 8.5):
        for x in (-hx, hx):
            slots.tree(kinds, (0.0, 0.6), (x, -0.03, t + slots.rng.uniform(-1.5, 1.5)), lean())


def taken(places: Sequence[Place], cost: Mapping[str, int], instances: int) -> list[Place]:
    """Return those of least rank that together are exactly `instances`, when one of a kind takes `cost` of them.

    Raises AssertionError where the places do not suffice: a mistake of the generator.
    """
    chosen = []
    for place in places:
        if cost[place.kind] <= instances:
            chosen.append(place)
            instances -= cost[place.kind]
        if not instances:
            break
    assert not instances, f"{instances} instances have no place"
    return chosen
