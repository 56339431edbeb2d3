"""The church on the square: nave, aisles, choir, and a tower with portal, clocks and spire."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from assets.city_facades import Look, Paint, arched_heads, bars, casings, open_wall, panes, reveals, sills
from assets.city_parts import OBJECT, Frame, Parts, side_frame, side_length
from assets.city_roofs import sloped
from assets.noise import Float64
from assets.shapes import Vector, lathe, rotation_y

WEST, EAST, MIDDLE = 13.0, 50.0, 22.0
"""x of the ends of the church in its block, and z of its axis."""

TOWER, NAVE, AISLE, CHOIR = 4.6, 5.0, 3.2, 3.6
"""Half of the widths of tower, nave and choir, and the width of an aisle."""

NAVE_X = WEST + 9.0, EAST - 6.5
FEET = (
    (WEST, MIDDLE - TOWER, WEST + 2 * TOWER, MIDDLE + TOWER),
    (NAVE_X[0], MIDDLE - NAVE - AISLE, NAVE_X[1], MIDDLE + NAVE + AISLE),
    (NAVE_X[1], MIDDLE - CHOIR, EAST, MIDDLE + CHOIR),
)
"""x0, z0, x1, z1 of the ground that tower, nave with aisles, and choir stand on."""

EAVE, AISLE_EAVE, LEAN = 15.0, 7.5, 2.6
"""Heights of the walls of nave and aisles, and of an aisle's roof, which leans on the nave."""

BELFRY = 25.0
PAINT = Paint((0.66, 0.6, 0.48), (0.7, 0.66, 0.56), (0.2, 0.19, 0.17), (0.16, 0.07, 0.03))
SLATE, COPPER = (0.17, 0.19, 0.23), (0.16, 0.24, 0.2)
WINDOWS = Look("ashlar", 3.6, 0.34, 0.2, 0.9, AISLE_EAVE, 0.0, reveal=0.45, bars=(1, 5), arched=True)


def church(level: int, rng: np.random.Generator) -> Parts:
    """Return the church in the frame of its block, the paving at height 0; `level` 0 is plain, 3 has all detail."""
    parts = Parts()
    for side, z in ((0, MIDDLE + NAVE), (2, MIDDLE - NAVE - AISLE)):
        _aisle(parts, side, z, level, rng)
    low, high = (NAVE_X[0], 0.0, MIDDLE - NAVE), (NAVE_X[1], EAVE, MIDDLE + NAVE)
    foot = AISLE_EAVE + LEAN
    upper = replace(WINDOWS, storey=EAVE - foot, share=0.3, bars=(1, 2))
    for side in (0, 2):
        _wall(parts, (low[0], foot, low[2]), high, side, upper, level, rng)
    for side in (1, 3):
        length = side_length(side, low, high)
        parts.grid(
            "ashlar",
            side_frame(side, low, high),
            np.array([0, length]),
            np.array([0, EAVE]),
            None,
            PAINT.wall,
        )
    gables = (True, False, True, False)
    sloped(parts, low, high, gables, "ashlar", PAINT.wall, SLATE, NAVE, 6.5)
    low, high = (NAVE_X[1], 0.0, MIDDLE - CHOIR), (EAST, 10.0, MIDDLE + CHOIR)
    for side in (0, 1, 2):
        _wall(parts, low, high, side, replace(WINDOWS, storey=10.0, bay=3.4), level, rng)
    sloped(parts, low, high, (True, True, True, False), "ashlar", PAINT.wall, SLATE, CHOIR, 4.0)
    _tower(parts, level, rng)
    return parts


def _aisle(parts: Parts, side: int, z: float, level: int, rng: np.random.Generator) -> None:
    """Add the aisle towards one side, from `z` on, with a roof that leans on the nave."""
    low, high = (NAVE_X[0], 0.0, z), (NAVE_X[1], AISLE_EAVE, z + AISLE)
    _wall(parts, low, high, side, WINDOWS, level, rng)
    ridge = AISLE_EAVE + LEAN
    for end in (1, 3):
        inner_left = (end == 1) == (side == 2)  # whether the nave is at the left end of this wall
        left, right = (ridge, AISLE_EAVE) if inner_left else (AISLE_EAVE, ridge)
        face = np.array([[(0, 0, 0), (AISLE, 0, 0), (AISLE, right, 0), (0, left, 0)]])
        parts.quads("ashlar", side_frame(end, low, high), face, PAINT.wall)
    length = side_length(side, low, high)
    roof = [(0, AISLE_EAVE, 0), (length, AISLE_EAVE, 0), (length, ridge, -AISLE), (0, ridge, -AISLE)]
    parts.quads("tiles", replace(side_frame(side, low, high), wall=False), np.array([roof]), SLATE)


def _wall(
    parts: Parts, low: Vector, high: Vector, side: int, look: Look, level: int, rng: np.random.Generator,
    buttressed: bool = True,
) -> None:  # fmt: skip
    """Add a wall of the box between two corners: arched windows, a cornice, and buttresses between the windows."""
    frame, length, top = side_frame(side, low, high), side_length(side, low, high), high[1] - low[1]
    rects = open_wall(parts, frame, look, PAINT, length, (0.0, top), 1).reshape(-1, 4)
    straight = rects.copy()
    straight[:, 3] -= (rects[:, 2] - rects[:, 0]) / 2 + 0.05
    arched_heads(parts, frame, look, PAINT, rects, 6 + 4 * level, level > 0)
    reveals(parts, frame, "ashlar", straight, look.reveal, PAINT.wall, top=False)
    panes(parts, frame, rects, look.reveal, rng, ("dark", "sky"))
    sills(parts, frame, rects, PAINT.trim)
    bars(parts, frame, rects, look.reveal, look.bars, PAINT.frame)
    if level > 1:
        casings(parts, frame, straight, look.reveal, PAINT.frame)
    cornice = [(0.0, top - 0.6), (0.2, top - 0.45), (0.35, top - 0.2), (0.4, top), (0.0, top + 0.1)]
    parts.moulding("painted", frame, (0.02, length - 0.02), cornice, PAINT.trim)
    if buttressed and len(rects) > 1:
        _buttresses(parts, frame, np.arange(1, len(rects)) * length / len(rects), top, level)


def _buttresses(parts: Parts, frame: Frame, x: Float64, top: float, level: int) -> None:
    """Add stepped pillars before a wall, centred on `x` (N,); each step has a sloping head."""
    for half, low, high, out in ((0.38, -0.1, 0.45 * top, 1.1), (0.32, 0.45 * top, 0.85 * top, 0.7)):
        a = np.stack([x - half, 0 * x + low, 0 * x], -1)
        b = np.stack([x + half, 0 * x + high, 0 * x + out], -1)
        parts.boxes("ashlar", frame, a, b, PAINT.wall, "xXZ")
        left_foot, right_foot, left_front, right_front, left_head, right_head = (
            np.stack([x + dx, 0 * x + y, 0 * x + z], -1)
            for y, z in ((high, 0.0), (high, out), (high + 0.7, 0.0))
            for dx in (-half, half)
        )
        slope = np.stack([left_front, right_front, right_head, left_head], 1)
        cheeks = [
            np.stack([left_foot, left_front, left_head, left_foot], 1),
            np.stack([right_front, right_foot, right_head, right_front], 1),
        ]
        parts.quads("painted", frame, slope, np.multiply(PAINT.trim, 0.8))
        parts.quads("ashlar", frame, np.concatenate(cheeks), PAINT.wall)
    if level > 1:
        shape = lathe(
            [[(0.0, top + 2.4), (0.28, top + 0.9)], [(0.28, top + 0.9), (0.28, 0.7 * top)]], 4, faceted=True
        )
        pinnacle = shape.turned(rotation_y(45)).painted(PAINT.trim)
        for middle in x:
            parts.add("painted", pinnacle.moved(frame.place(np.array([middle, 0.0, 0.55]))))


def _tower(parts: Parts, level: int, rng: np.random.Generator) -> None:
    """Add the tower at the west end."""
    low, high = (WEST, 0.0, MIDDLE - TOWER), (WEST + 2 * TOWER, BELFRY, MIDDLE + TOWER)
    look = replace(WINDOWS, bay=4.6, share=0.38, sill=0.72, head=0.95, storey=BELFRY, bars=(0, 5))
    clock = lathe(
        [[(0.0, 0.12), (1.25, 0.12)], [(1.25, 0.2), (1.45, 0.2)], [(1.45, 0.2), (1.5, 0.0)]], 8 + 8 * level
    )
    spike = [[(0.0, 6.0), (0.5, 2.6)], [(0.62, 2.6), (0.62, 2.3)], [(0.5, 2.3), (0.5, -0.2)]]
    pinnacle = lathe(spike, 8, faceted=True).painted(PAINT.trim)
    for side in range(4):
        frame = side_frame(side, low, high)
        _wall(parts, low, high, side, look, level, rng, buttressed=False)
        for y in (9.0, 16.5):
            band = [(0.0, y), (0.22, y + 0.08), (0.22, y + 0.3), (0.0, y + 0.42)]
            parts.moulding("painted", frame, (0.0, 2 * TOWER), band, PAINT.trim, (True, True))
        facing_out = frame.axes @ np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])
        face = clock.turned(facing_out).painted((0.75, 0.73, 0.66))
        parts.add("painted", face.moved(frame.place(np.array([TOWER, 14.2, 0.0]))))
        hands = np.array([[TOWER - 0.05, 14.2, 0.12], [TOWER, 14.15, 0.12]])
        sizes = np.array([[0.1, 1.0, 0.03], [0.7, 0.1, 0.05]])
        parts.boxes("painted", frame, hands, hands + sizes, (0.03, 0.03, 0.03), "xXyYZ")
        parts.add("painted", pinnacle.moved(frame.place(np.array([0.55, BELFRY, -0.55]))))
    _portal(parts, side_frame(3, low, high))
    x, z = WEST + TOWER, MIDDLE
    corners = [(-TOWER, TOWER), (TOWER, TOWER), (TOWER, -TOWER), (-TOWER, -TOWER)]
    parts.quads("painted", OBJECT, np.array([[(x + dx, BELFRY, z + dz) for dx, dz in corners]]), SLATE)
    spire = lathe(
        [[(0.0, 49.0), (0.3, 47.0), (1.4, 38.0), (3.3, 27.0)], [(3.3, 27.0), (3.6, 24.9)]], 8, faceted=True
    )
    parts.add("painted", spire.painted(COPPER).moved((x, 0.0, z)))
    cross_low = np.array([(x - 0.08, 48.6, z - 0.08), (x - 0.07, 50.2, z - 0.7)])
    cross_high = np.array([(x + 0.08, 51.4, z + 0.08), (x + 0.07, 50.4, z + 0.7)])
    parts.boxes("painted", OBJECT, cross_low, cross_high, (0.6, 0.42, 0.08))


def _portal(parts: Parts, frame: Frame) -> None:
    """Add a door between nested jambs before the west face, with a gable over it."""
    half, lintel = 1.3, 3.9
    left, right = TOWER - half, TOWER + half
    door = [(left, 0.0, 0.06), (right, 0.0, 0.06), (right, lintel, 0.06), (left, lintel, 0.06)]
    parts.quads("painted", frame, np.array([door]), PAINT.accent)
    split = np.array([[TOWER - 0.04, 0.0, 0.06]])
    parts.boxes("painted", frame, split, split + np.array([0.08, lintel, 0.05]), (0.05, 0.03, 0.02), "xXZ")
    for k in range(3):
        out = 0.9 - 0.25 * k
        low = np.array([(left - 0.3 * (k + 1), -0.1, 0.0), (right + 0.3 * k, -0.1, 0.0)])
        high = np.array([(left - 0.3 * k, lintel, out), (right + 0.3 * (k + 1), lintel, out)])
        parts.boxes("ashlar", frame, low, high, PAINT.trim, "xXZ")
    wide, foot, peak, out = half + 1.15, lintel + 0.6, lintel + 3.9, 1.05
    parts.boxes("painted", frame, (TOWER - wide, lintel, 0.0), (TOWER + wide, foot, out), PAINT.trim, "xXyYZ")
    a, b, top = (TOWER - wide, foot, out - 0.2), (TOWER + wide, foot, out - 0.2), (TOWER, peak, out - 0.2)
    back = np.array([0.0, 0.0, out - 0.2])
    front, slope_left = [a, b, top, a], [a, top, np.subtract(top, back), np.subtract(a, back)]
    slope_right = [b, np.subtract(b, back), np.subtract(top, back), top]
    parts.quads("painted", frame, np.array([front, slope_left, slope_right]), PAINT.trim)
