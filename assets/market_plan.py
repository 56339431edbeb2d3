"""The plan of the night market: rows of stalls along six lanes, a square, strings between masts, and where lamps hang.

x runs along the lanes and z across them; all lengths are in metres. Stalls of two lanes stand back to back, two alleys
run across, and the middle of the two inner lanes is the square.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from assets.noise import Float64

HALF = 28.5
"""From the middle to the facades around."""

LANES = (-22.0, -13.2, -4.4, 4.4, 13.2, 22.0)
HALF_LANE = 2.1
PITCH = 3.4
"""From the middle of a stall to that of the next one."""

BLOCKS = ((-25.3, 3), (-11.9, 7), (15.1, 3))
"""Where stalls stand along a row: the left end of each block, and how many there are."""

SQUARE = (11.9, 6.5)
"""Half the width and depth of the square."""

MAST_X, MAST_Z, MAST_TOP = 1.5, 0.1, 3.15
"""Where the masts of a stall stand, left and right of its middle and behind its front; the height of their tops."""

BIG_MAST_X, BIG_MAST_TOP = 5.6, 6.0
HOOK_TOP = 3.9
"""Height of the hooks in the facades, to which strings run."""

MOST_LAMPS = 4096
GOLDEN = (math.sqrt(5.0) - 1.0) / 2.0
KINDS = ("bulb", "paper", "drum", "globe", "wall", "head")
"""Of lamps: three that hang on strings, one below awnings, one on facades, and the heads of poles, which are spots."""

COLORS = (
    (1.0, 0.80, 0.55), (1.0, 0.68, 0.34), (1.0, 0.50, 0.18), (1.0, 0.27, 0.13),
    (1.0, 0.42, 0.46), (0.45, 0.95, 0.62), (0.42, 0.62, 1.0),
)  # fmt: skip
"""Linear colours of lamps: warm white, amber, orange, red, rose, green and blue."""

SHARES = (0.30, 0.28, 0.16, 0.12, 0.07, 0.04, 0.03)
SPACING = {"bulb": 0.37, "paper": 0.66, "drum": 0.58}
DROP = {"bulb": 0.09, "paper": 0.21, "drum": 0.22}
"""From the wire to the middle of a lamp."""

LEAST_RANGE, MOST_RANGE, HEAD_RANGE = 2.5, 6.0, 8.5
LEAST_CANDELA, MOST_CANDELA, HEAD_CANDELA = 5.0, 60.0, 260.0
HIGH = 3.15
"""A lamp above this height is one of the larger ones."""

POLE_TOP = 5.1
KNOTS = np.linspace(0.0, 1.0, 5)
"""The ends of the straight parts of a wire."""

Point = tuple[float, float, float]


@dataclass(frozen=True)
class Stall:
    """A stall: the middle of its front line, and its turn about y in degrees; at 0 it looks towards +z."""

    x: float
    z: float
    turn: float

    def place(self, x: float, y: float, z: float) -> Point:
        """Return a point of the stall's own frame in the world."""
        sign = 1.0 if self.turn == 0.0 else -1.0
        return self.x + sign * x, y, self.z + sign * z


@dataclass(frozen=True)
class String:
    """A wire between two points that sags by `sag` in its middle, and the kind of lamp that hangs on it.

    It has four straight parts between points of a parabola.
    """

    start: Point
    end: Point
    sag: float
    kind: str

    def points(self, t: Float64) -> Float64:
        """Return points (N, 3) at parts `t` (N,) of the way."""
        a, b = np.array(self.start), np.array(self.end)
        line = a + (b - a) * t[:, None]
        line[:, 1] -= self.sag * np.interp(t, KNOTS, 4.0 * KNOTS * (1.0 - KNOTS))
        return line

    @property
    def length(self) -> float:
        return math.dist(self.start, self.end)


@dataclass(frozen=True)
class Lamp:
    """A lamp: where its light is, its kind, the number of its colour, its range in metres and its candela.

    The head of a pole shines towards `target`.
    """

    at: Point
    kind: str
    color: int
    reach: float
    candela: float
    target: Point | None = None


@dataclass(frozen=True)
class Pole:
    """A pole at (x, z) with the points on the ground that its heads shine at; `top` is the height of the heads."""

    x: float
    z: float
    top: float
    targets: tuple[Point, ...]


def stalls() -> list[Stall]:
    """Return all stalls, row by row."""
    found = []
    for lane in LANES:
        for z, turn in ((lane - HALF_LANE, 0.0), (lane + HALF_LANE, 180.0)):
            for left, count in BLOCKS:
                if abs(z) < SQUARE[1] - 1.0 and abs(left) < SQUARE[0] + 0.1:
                    continue  # the square
                found += [Stall(left + (k + 0.5) * PITCH, z, turn) for k in range(count)]
    return found


def poles() -> list[Pole]:
    """Return the poles with spot lights: in the alleys, at the ends of the rows, and the big masts of the square."""
    found = []
    for z in (-17.6, -8.8, 8.8, 17.6):
        for x in (-12.3, 12.3):
            middle = math.copysign(13.5, x)
            found.append(Pole(x, z, POLE_TOP, ((middle, 0.0, z - 3.2), (middle, 0.0, z + 3.2))))
    for z in (-17.6, -8.8, 0.0, 8.8, 17.6):
        for x in (-26.0, 26.0):
            found.append(Pole(x, z, POLE_TOP, ((math.copysign(24.0, x), 0.0, z + 1.5),)))
    for x in (-BIG_MAST_X, BIG_MAST_X):
        aims = tuple((x + dx, 0.0, dz) for dx in (-3.0, 3.0) for dz in (-3.4, 3.4))
        found.append(Pole(x, 0.0, BIG_MAST_TOP - 0.5, aims))
    return found


def _mast_rows() -> dict[tuple[float, int], list[list[float]]]:
    """Return x of the masts of each block, by lane and side (-1: the row before the lane's middle, 1: behind it)."""
    rows: dict[tuple[float, int], list[list[float]]] = {}
    for lane in LANES:
        for side in (-1, 1):
            z = lane + side * HALF_LANE
            blocks = []
            for left, count in BLOCKS:
                gone = abs(z) < SQUARE[1] - 1.0 and abs(left) < SQUARE[0] + 0.1
                xs = [left + (k + 0.5) * PITCH - MAST_X for k in range(count)]
                blocks.append([] if gone else [*xs, left + (count - 0.5) * PITCH + MAST_X])
            rows[lane, side] = blocks
    return rows


def strings() -> list[String]:
    """Return the wires: over lanes and alleys, along fronts, to the facades, and from the big masts of the square."""
    rng, found = np.random.default_rng(2101), list[String]()

    def add(a: Point, b: Point, kinds: tuple[str, ...] = ("bulb", "bulb", "paper", "drum")) -> None:
        sag = math.dist(a, b) * float(rng.uniform(0.035, 0.06))
        found.append(String(a, b, sag, kinds[int(rng.integers(len(kinds)))]))

    def top(x: float, z: float) -> Point:
        return x, MAST_TOP, z

    rows, out = _mast_rows(), HALF_LANE + MAST_Z
    for lane in LANES:
        near, far = lane - out, lane + out
        for a, b in zip(rows[lane, -1], rows[lane, 1], strict=True):
            for z, xs in ((near, a), (far, b)):
                for x, after in pairwise(xs):
                    add(top(x, z), top(after, z), ("bulb",))
            if a and b:
                for k, x in enumerate(a):
                    add(top(x, near), top(x, far))
                    if k + 1 < len(a):
                        ends = (x, a[k + 1]) if k % 2 else (a[k + 1], x)
                        add(top(ends[0], near), top(ends[1], far))
        for side, z in ((-1, near), (1, far)):
            blocks = rows[lane, side]
            for left, right in ((blocks[0], blocks[1]), (blocks[1], blocks[2])):
                if left and right:
                    add(top(left[-1], z), top(right[0], z))
            add(top(blocks[0][0], z), (-HALF + 0.1, HOOK_TOP, z))
            add(top(blocks[2][-1], z), (HALF - 0.1, HOOK_TOP, z))
    for lane, after in pairwise(LANES):
        for k in (0, 1):
            beside = (rows[lane, 1][k], rows[after, -1][k], rows[lane, 1][k + 1], rows[after, -1][k + 1])
            if not all(beside):
                continue
            x0, x1 = beside[0][-1], beside[2][0]
            add(top(x0, lane + out), top(x0, after - out), ("bulb",))
            add(top(x1, lane + out), top(x1, after - out), ("bulb",))
            add(top(x0, lane + out), top(x1, after - out))
            add(top(x1, lane + out), top(x0, after - out))
    for side, lane in ((-1, LANES[0]), (1, LANES[-1])):  # over the outer stalls to the facades
        for xs in rows[lane, side]:
            for x in xs[::2]:
                add(top(x, lane + side * out), (x, HOOK_TOP, side * (HALF - 0.1)), ("bulb", "paper"))
    for side, lane in ((-1, -4.4), (1, 4.4)):
        for x in rows[lane, side][1]:
            mast = math.copysign(BIG_MAST_X, x + 0.01)
            add((mast, BIG_MAST_TOP, 0.0), top(x, lane + side * out))
    for x in (-BIG_MAST_X, BIG_MAST_X):
        for z in (-2.2, 2.2):
            add((x, BIG_MAST_TOP, 0.0), top(math.copysign(15.3, x), z), ("bulb", "paper"))
    add((-BIG_MAST_X, BIG_MAST_TOP, 0.0), (BIG_MAST_X, BIG_MAST_TOP, 0.0), ("paper",))
    return found


def lamps(number: int) -> list[Lamp]:
    """Return so many lamps, at most MOST_LAMPS: the first of one fixed order, in which they thin out evenly.

    The order takes places along strings and rows by the fractional part of their number times the golden ratio: any
    beginning of it is spread as evenly over all numbers as it can be.
    """
    every = _all_lamps()
    assert number <= MOST_LAMPS <= len(every)
    order = np.argsort(np.arange(1, len(every) + 1) * GOLDEN % 1.0, kind="stable")
    return [every[k] for k in order[:number]]


def _all_lamps() -> list[Lamp]:
    """Return a lamp for every place there is, in the order of strings and rows."""
    rng, found = np.random.default_rng(2201), list[Lamp]()

    def add(at: Point, kind: str, color: int) -> None:
        # Most reach the ground and little more; those that hang high or light walls are the larger ones.
        chance, high = float(rng.random()), at[1] > HIGH or kind == "wall"
        part = 0.62 + 0.38 * chance if high else chance**4.6
        reach = LEAST_RANGE + (MOST_RANGE - LEAST_RANGE) * part
        candela = (LEAST_CANDELA + (MOST_CANDELA - LEAST_CANDELA) * part) * float(rng.uniform(0.9, 1.0))
        found.append(Lamp(at, kind, color, reach, max(candela, LEAST_CANDELA)))

    def color() -> int:
        return int(rng.choice(len(COLORS), p=SHARES))

    for string in strings():
        count = max(2, int(string.length / SPACING[string.kind]))
        one = color() if string.kind != "bulb" or rng.random() < 0.25 else int(rng.random() < 0.5)
        for x, y, z in string.points((np.arange(count) + 0.5) / count):
            mixed = color() if string.kind != "bulb" and rng.random() < 0.3 else one
            add((float(x), float(y) - DROP[string.kind], float(z)), string.kind, mixed)
    for stall in stalls():
        paint = int(rng.choice(3, p=(0.5, 0.35, 0.15)))
        for x, y, z in ((-0.75, 1.93, -0.45), (0.75, 1.93, -0.45), (0.0, 1.93, -1.5)):
            add(stall.place(x, y, z), "globe", paint)
    for place in wall_places():
        add(place[0], "wall", int(rng.choice(2)))
    for pole in poles():
        for target in pole.targets:
            found.append(Lamp(head_place(pole, target), "head", 0, HEAD_RANGE, HEAD_CANDELA, target))
    return found


def head_place(pole: Pole, target: Point) -> Point:
    """Return where a pole's head shines from: at the end of an arm towards its target."""
    away = np.array([target[0] - pole.x, target[2] - pole.z])
    arm = 0.5 * away / np.hypot(*away)
    return pole.x + float(arm[0]), pole.top, pole.z + float(arm[1])


def wall_places() -> list[tuple[Point, float]]:
    """Return where the lanterns of the facades are, and by how many degrees their walls are turned about y."""
    found, height, away = [], 3.15, HALF - 0.42
    for along in np.linspace(-25.5, 25.5, 18).tolist():
        found += [((along, height, -away), 0.0), ((along, height, away), 180.0)]
        found += [((-away, height, along), 90.0), ((away, height, along), 270.0)]
    return found
