"""The plan: a grid of streets and blocks, what each block is for, and lots between neighbours.

x runs to the right on the plan and z downwards; lengths are metres. A block is the rectangle inside its pavement.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from assets.city_buildings import Lot, Side
from assets.noise import Float64

BLOCK = (60.0, 44.0)
PAVEMENT, KERB = 4.0, 0.15
"""Width of a pavement and its height above the road."""

STREET, AVENUE = 9.0, 14.0
"""Widths of the carriageway."""

CORNER, DEPTH = 13.0, 15.0
"""Width of the lots at the corners of a block, and depth of its two rows of lots."""

ROWS = ((17.0, 17.0), (10.0, 12.0, 12.0), (14.0, 20.0), (12.0, 11.0, 11.0), (20.0, 14.0))
"""How the 34 m between two corners may be divided."""

TRIANGLES_PER_BLOCK = 14000
SMALL = 40000
"""A city of fewer triangles than this has low houses, and open blocks."""


@dataclass(frozen=True)
class Block:
    """One block: its corner with least x and z, and its kind: "houses", "square", "park" or "tower".

    `lots` are relative to the corner. `yards` says whether the block is open towards -x and +x between its rows.
    """

    column: int
    row: int
    x: float
    z: float
    kind: str
    lots: tuple[Lot, ...] = ()
    yards: tuple[bool, bool] = (False, False)


@dataclass(frozen=True)
class Plan:
    """All blocks, and for each street along z (`road_x`) and along x (`road_z`) its middle and its width."""

    columns: int
    rows: int
    road_x: tuple[tuple[float, float], ...]
    road_z: tuple[tuple[float, float], ...]
    blocks: tuple[Block, ...]

    @property
    def half(self) -> Float64:
        """Half the size (2,) of the city along x and z, outer streets included."""
        return np.array(
            [self.road_x[-1][0] + self.road_x[-1][1] / 2, self.road_z[-1][0] + self.road_z[-1][1] / 2]
        )

    def of_kind(self, kind: str) -> list[Block]:
        """Return the blocks of a kind, those nearest to the middle first."""
        chosen = [block for block in self.blocks if block.kind == kind]
        return sorted(chosen, key=lambda block: math.hypot(block.x + BLOCK[0] / 2, block.z + BLOCK[1] / 2))


def make_plan(triangles: int) -> Plan:
    """Return the plan of a city of about so many unique triangles."""
    count = max(1.0, triangles / TRIANGLES_PER_BLOCK)
    columns = max(1, round(math.sqrt(count)))
    rows = max(1, round(count / columns))
    road_x, block_x = _line(columns, BLOCK[0])
    road_z, block_z = _line(rows, BLOCK[1])
    rng = np.random.default_rng(1001)
    kinds = _kinds(columns, rows, rng)
    blocks = []
    for row in range(rows):
        for column in range(columns):
            kind = kinds[row, column]
            block = Block(column, row, block_x[column], block_z[row], kind)
            if kind == "houses":
                far = math.hypot((column + 0.5) / columns - 0.5, (row + 0.5) / rows - 0.5) * 1.4
                block = _with_lots(block, 1.0 - far, triangles < SMALL, rng)
            blocks.append(block)
    return Plan(columns, rows, tuple(road_x), tuple(road_z), tuple(blocks))


def _line(count: int, block: float) -> tuple[list[tuple[float, float]], list[float]]:
    """Return the streets (middle, width) and the starts of blocks along one axis, centred on 0."""
    widths = [AVENUE if k % 3 == 1 else STREET for k in range(count + 1)]
    total = sum(widths) + count * (block + 2 * PAVEMENT)
    at, roads, blocks = -total / 2, [], []
    for k, width in enumerate(widths):
        roads.append((at + width / 2, width))
        at += width
        if k < count:
            blocks.append(at + PAVEMENT)
            at += block + 2 * PAVEMENT
    return roads, blocks


def _kinds(
    columns: int, rows: int, rng: np.random.Generator
) -> np.ndarray[tuple[int, ...], np.dtype[np.str_]]:
    """Return what each block (R, C) is for: squares in the middle, towers around them, parks further out."""
    kinds = np.full((rows, columns), "houses", dtype="<U8")
    count = rows * columns
    if count < 4:
        return kinds
    row, column = np.divmod(np.arange(count), columns)
    far = np.hypot((column + 0.5) / columns - 0.5, (row + 0.5) / rows - 0.5) + 0.18 * rng.random(count)
    order = np.argsort(far, kind="stable")
    kinds[rows // 2, columns // 2 - 1] = "square"
    free = [k for k in order if kinds.flat[k] == "houses"]
    towers, parks, squares = (count + 3) // 12, count // 14 + (count >= 9), count // 40
    for kind, number, start in (
        ("tower", towers, 0),
        ("park", parks, count // 4),
        ("square", squares, count // 2),
    ):
        step = max(1, (len(free) - start) // (2 * max(1, number)))
        for k in free[start::step][:number]:
            kinds.flat[k] = kind
        free = [k for k in free if kinds.flat[k] == "houses"]
    return kinds


def _with_lots(block: Block, middle: float, small: bool, rng: np.random.Generator) -> Block:
    """Return a block of houses: two rows of lots back to back, closed at both ends or open to a yard.

    `middle` is 1 in the middle of the city, where houses are higher, and 0 at its edge.
    """
    yards = (small or bool(rng.random() < 0.15), small or bool(rng.random() < 0.15))
    rects = []
    for z in (0.0, BLOCK[1] - DEPTH):
        widths = (CORNER, *ROWS[rng.integers(len(ROWS))], CORNER)
        starts = np.cumsum([0.0, *widths[:-1]])
        rects += [(float(x), z, width, DEPTH) for x, width in zip(starts, widths, strict=True)]
    for is_yard, x in zip(yards, (0.0, BLOCK[0] - CORNER), strict=True):
        if not is_yard:
            rects.append((x, DEPTH, CORNER, BLOCK[1] - 2 * DEPTH))
    lots = [_lot(rect, middle, rng) for rect in rects]
    if small:
        lots = [replace(lot, storeys=1) for lot in lots]
    return replace(block, lots=tuple(replace(lot, sides=_sides(lot, lots)) for lot in lots), yards=yards)


def _lot(rect: tuple[float, float, float, float], middle: float, rng: np.random.Generator) -> Lot:
    corner = rect[2] == CORNER
    looks = ["tenement", "townhouse", "bank", "palace", "slab", "works"]
    weights = np.array([0.26, 0.28, 0.12, 0.14, 0.1 + 0.1 * (not corner), 0.1])
    look = str(rng.choice(looks, p=weights / weights.sum()))
    storeys = int(rng.integers(2, 5)) + round(2.6 * max(middle, 0.0) ** 1.5 * rng.random())
    roof = "flat"
    if look == "townhouse":
        roof = "mansard" if rng.random() < 0.7 or corner else "hipped"
    elif look == "palace":
        roof = "hipped" if rng.random() < 0.5 else "flat"
    if look in ("bank", "works"):
        storeys = max(2, storeys - 1)
    none = Side("court")
    return Lot(*rect, look, storeys, roof, (none, none, none, none))


def _sides(lot: Lot, lots: list[Lot]) -> tuple[Side, Side, Side, Side]:
    """Return what is on the sides of a lot; a neighbour that touches a side shares all of it."""
    x0, z0, x1, z1 = lot.x, lot.z, lot.x + lot.width, lot.z + lot.depth
    outside = (z1 == BLOCK[1], x1 == BLOCK[0], z0 == 0.0, x0 == 0.0)

    def side(number: int) -> Side:
        if outside[number]:
            return Side("street")
        for other in lots:
            a0, b0, a1, b1 = other.x, other.z, other.x + other.width, other.z + other.depth
            touches = ((b0 == z1), (a0 == x1), (b1 == z0), (a1 == x0))[number]
            shared = (a0, a1) == (x0, x1) if number % 2 == 0 else (b0, b1) == (z0, z1)
            if touches and shared:
                return Side("party", other.eave)
        return Side("court")

    return side(0), side(1), side(2), side(3)
