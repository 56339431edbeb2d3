"""Roofs: decks behind parapets, hipped and mansard roofs with dormers, chimneys, huts and skylights."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from assets.city_facades import Paint, casings, panes
from assets.city_parts import OBJECT, Color, Frame, Parts, side_frame, side_length
from assets.noise import Float64
from assets.shapes import Vector, lathe

PARAPET, WALL = 0.9, 0.3
"""Height above the deck and thickness of a parapet, metres."""

BITUMEN = (0.16, 0.155, 0.15)
TONES = ((0.55, 0.17, 0.09), (0.42, 0.14, 0.09), (0.16, 0.17, 0.2), (0.26, 0.2, 0.17))
"""Linear colours that tint the picture of roof tiles."""


def deck(parts: Parts, low: Vector, high: Vector, color: Sequence[float], trim: Sequence[float]) -> None:
    """Add a flat roof: a deck at height high[1] - PARAPET, and around it a parapet with a coping at high[1]."""
    x0, z0, x1, z1 = low[0], low[2], high[0], high[2]
    top = high[1]
    outer = np.array([(x0, top, z1), (x1, top, z1), (x1, top, z0), (x0, top, z0)])
    x2, x3, z2, z3 = x0 + WALL, x1 - WALL, z0 + WALL, z1 - WALL
    inner = np.array([(x2, top, z3), (x3, top, z3), (x3, top, z2), (x2, top, z2)])
    after = [1, 2, 3, 0]
    coping = np.stack([outer, outer[after], inner[after], inner], 1)
    foot = inner - [0, PARAPET, 0]
    inside = np.stack([foot[after], foot, inner, inner[after]], 1)
    parts.quads("painted", OBJECT, coping, trim)
    parts.quads("painted", OBJECT, inside, np.multiply(color, 0.55))
    floor = foot[None]
    parts.quads("painted", OBJECT, floor, BITUMEN)


def sloped(
    parts: Parts, low: Vector, high: Vector, open_sides: Sequence[bool], wall: str, color: Sequence[float],
    tone: Color, inset: float, rise: float,
) -> None:  # fmt: skip
    """Add a roof on the rectangle between two corners at height high[1]: open sides slope inwards, others are gables.

    It is `rise` high where it has come `inset` inwards; what is left of the rectangle there is flat.
    """
    y, top = high[1], high[1] + rise
    corners = np.array([(low[0], high[2]), (high[0], high[2]), (high[0], low[2]), (low[0], low[2])])
    shift = [inset if is_open else 0.0 for is_open in open_sides]  # of sides +z, +x, -z, -x
    upper = corners + np.array(
        [(shift[3], -shift[0]), (-shift[1], -shift[0]), (-shift[1], shift[2]), (shift[3], shift[2])]
    )
    foot = np.insert(corners, 1, y, axis=1)
    ridge = np.insert(upper, 1, top, axis=1)
    for side in range(4):
        after = (side + 1) % 4
        face = np.array([[foot[side], foot[after], ridge[after], ridge[side]]])
        across = np.linalg.norm(foot[after] - foot[side])
        if open_sides[side]:
            length = np.hypot(inset, rise)
            lead = np.array([0.0, across, across - shift[after], shift[side - 1]])
            uv = np.stack([lead, [length, length, 0.0, 0.0]], -1)[None] / 1.8
            parts.quads("tiles", OBJECT, face, tone, uv=uv)
        else:
            parts.quads(wall, OBJECT, face, np.multiply(color, 0.85))
    parts.quads("painted", OBJECT, ridge[None], (0.2, 0.2, 0.21))


def dormers(
    parts: Parts, frame: Frame, at: Float64, y: float, paint: Paint, level: int, rng: np.random.Generator
) -> None:
    """Add dormer windows in a steep roof over a wall, centred on `at` (N,), with their sills at height `y`."""
    half, tall, front, back = 0.7, 1.75, -0.12, -1.6
    low = np.stack([at - half, 0 * at + y, 0 * at + back], -1)
    high = np.stack([at + half, 0 * at + y + tall, 0 * at + front], -1)
    parts.boxes("painted", frame, low, high, (0.3, 0.31, 0.33), "xX")
    rects = np.stack([at - half, 0 * at + y, at + half, 0 * at + y + tall], -1)
    panes(parts, frame, rects, 0.18, rng, ("curtain", "dark"))
    casings(parts, frame, rects, 0.18, paint.trim)
    # A roof of two slopes in front of the main one.
    eave, peak, out = y + tall, y + tall + 0.5, front + 0.2
    ends = [np.stack([at + dx, 0 * at + dy, 0 * at + dz], -1)
            for dz in (out, back - 0.6)
            for dx, dy in ((-half - 0.12, eave), (0.0, peak), (half + 0.12, eave))]  # fmt: skip
    left = np.stack([ends[0], ends[1], ends[4], ends[3]], 1)
    right = np.stack([ends[1], ends[2], ends[5], ends[4]], 1)
    parts.quads("tiles", frame, np.concatenate([left, right]), (0.2, 0.21, 0.24))
    gable = np.stack([ends[0], ends[2], ends[1], ends[0]], 1)
    parts.quads("painted", frame, gable, paint.trim)
    if level > 1:
        soffit = np.stack([ends[3], ends[5], ends[2], ends[0]], 1)
        parts.quads("painted", frame, soffit, paint.trim)


def chimney(
    parts: Parts, at: tuple[float, float], low: float, high: float, size: tuple[float, float], level: int
) -> None:
    """Add a chimney of brick around (x, z), from height `low` inside a roof to `high`, with a cap and pots."""
    (x, z), (sx, sz) = at, size
    parts.boxes(
        "painted",
        OBJECT,
        (x - sx / 2, low, z - sz / 2),
        (x + sx / 2, high, z + sz / 2),
        (0.5, 0.24, 0.17),
        "xXzZ",
    )
    a, b = (x - sx / 2 - 0.08, high, z - sz / 2 - 0.08), (x + sx / 2 + 0.08, high + 0.15, z + sz / 2 + 0.08)
    parts.boxes("painted", OBJECT, a, b, (0.4, 0.37, 0.33))
    if level:
        count = max(1, round(max(size) / 0.45))
        pot = lathe([[(0.09, 0.45), (0.13, 0.45)], [(0.13, 0.45), (0.11, 0.38), (0.13, 0.0)]], 6 + 2 * level)
        for k in range(count):
            step = ((k + 0.5) / count - 0.5) * max(size)
            offset = (x + (step if sx >= sz else 0), high + 0.15, z + (step if sz > sx else 0))
            parts.add("painted", pot.moved(offset).painted((0.52, 0.2, 0.11)))


def hut(parts: Parts, low: Vector, high: Vector, color: Sequence[float]) -> None:
    """Add the top of a staircase on a deck: a box with a door and an overhanging lid."""
    parts.boxes("painted", OBJECT, low, high, color, "xXzZ")
    rim = 0.2
    lid_low = (low[0] - rim, high[1], low[2] - rim)
    parts.boxes(
        "painted", OBJECT, lid_low, (high[0] + rim, high[1] + 0.18, high[2] + rim), (0.22, 0.22, 0.22)
    )
    frame = side_frame(0, low, high)
    x = side_length(0, low, high) / 2
    parts.boxes("painted", frame, (x - 0.5, 0, 0), (x + 0.5, 2.05, 0.05), (0.2, 0.23, 0.27), "xXYZ")


def skylights(parts: Parts, centers: Float64, y: float, size: tuple[float, float]) -> None:
    """Add glazed ridges along z on a deck at height `y`, around (x, z) of `centers` (N, 2)."""
    sx, sz = size
    x, z = np.asarray(centers, np.float64).T
    kerb, peak = y + 0.3, y + 1.2
    low = np.stack([x - sx / 2, 0 * x + y - 0.05, z - sz / 2], -1)
    high = np.stack([x + sx / 2, 0 * x + kerb, z + sz / 2], -1)
    parts.boxes("painted", OBJECT, low, high, (0.3, 0.3, 0.3), "xXzZ")

    def points(dx: float, height: float, dz: float) -> Float64:
        return np.stack([x + dx * sx / 2, 0 * x + height, z + dz * sz / 2], -1)

    slopes = [
        np.stack([points(-1, kerb, -1), points(-1, kerb, 1), points(0, peak, 1), points(0, peak, -1)], 1),
        np.stack([points(1, kerb, 1), points(1, kerb, -1), points(0, peak, -1), points(0, peak, 1)], 1),
    ]
    inside = np.array([(0.03, 0.22), (0.22, 0.22), (0.22, 0.03), (0.03, 0.03)])
    for slope in slopes:
        parts.quads("window", OBJECT, slope, (1, 1, 1), uv=np.broadcast_to(inside, (len(x), 4, 2)))
    ends = [
        np.stack([points(-1, kerb, 1), points(1, kerb, 1), points(0, peak, 1), points(-1, kerb, 1)], 1),
        np.stack([points(1, kerb, -1), points(-1, kerb, -1), points(0, peak, -1), points(1, kerb, -1)], 1),
    ]
    parts.quads("painted", OBJECT, np.concatenate(ends), (0.3, 0.3, 0.3))
