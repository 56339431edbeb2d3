"""Buildings: a lot between neighbours becomes walls, ledges and a roof, in one of several looks."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from assets.city_facades import (
    Look,
    Paint,
    Rgb,
    arched_heads,
    balconies,
    bars,
    bays_of,
    casings,
    hoods,
    open_wall,
    panes,
    pierced_wall,
    pilasters,
    reveals,
    sills,
    surrounds,
)
from assets.city_grounds import ground_floor
from assets.city_parts import Frame, Parts, side_frame, side_length
from assets.city_roofs import PARAPET, TONES, chimney, deck, dormers, hut, skylights, sloped
from assets.noise import Float64

LOOKS = {
    "tenement": Look("brick", 2.7, 0.44, 0.26, 0.82, 3.4, 4.3, bars=(0, 1), hood="lintel", crown="bracketed"),
    "townhouse": Look("plaster", 2.9, 0.42, 0.2, 0.84, 3.5, 4.2, surround=True, hood="ledge", balconies="iron",
                      crown="moulded"),
    "bank": Look("ashlar", 3.5, 0.46, 0.2, 0.86, 4.0, 5.4, reveal=0.35, bars=(1, 2), hood="gable", pilasters=True,
                 crown="bracketed", grounds=("arches",)),
    "palace": Look("plaster", 3.3, 0.46, 0.2, 0.88, 4.2, 5.2, reveal=0.3, bars=(1, 2), arched=True, crown="moulded",
                   grounds=("arches", "shops")),
    "slab": Look("concrete", 3.6, 0.74, 0.26, 0.84, 3.1, 4.0, bars=(2, 0), balconies="solid", crown="plain"),
    "works": Look("brick", 4.3, 0.7, 0.2, 0.9, 4.4, 4.9, reveal=0.3, bars=(3, 4), arched=True, pilasters=True,
                  crown="plain", grounds=("shops", "arches")),
}  # fmt: skip
TOWER = Look(
    "concrete", 2.6, 0.86, 0.1, 0.96, 3.8, 5.5, reveal=0.12, bars=(0, 0), crown="plain", grounds=("lobby",)
)

WALLS = {
    "brick": ((0.62, 0.28, 0.2), (0.5, 0.2, 0.15), (0.68, 0.42, 0.28), (0.42, 0.3, 0.26), (0.72, 0.55, 0.4)),
    "plaster": ((0.72, 0.58, 0.36), (0.68, 0.4, 0.28), (0.62, 0.62, 0.55), (0.42, 0.52, 0.56), (0.74, 0.7, 0.6),
                (0.55, 0.6, 0.42), (0.7, 0.48, 0.42), (0.78, 0.66, 0.42)),
    "ashlar": ((0.68, 0.62, 0.5), (0.6, 0.58, 0.54), (0.7, 0.56, 0.42)),
    "concrete": ((0.62, 0.61, 0.58), (0.7, 0.66, 0.58), (0.5, 0.54, 0.57), (0.62, 0.5, 0.42)),
}  # fmt: skip
TRIMS = ((0.66, 0.63, 0.55), (0.75, 0.73, 0.68), (0.5, 0.46, 0.4), (0.58, 0.5, 0.38))
FRAMES = ((0.72, 0.72, 0.7), (0.08, 0.1, 0.09), (0.2, 0.1, 0.06), (0.08, 0.16, 0.13))
ACCENTS = ((0.03, 0.12, 0.09), (0.25, 0.03, 0.03), (0.02, 0.05, 0.16), (0.12, 0.06, 0.03), (0.3, 0.18, 0.03))


@dataclass(frozen=True)
class Side:
    """What is on one side of a lot: a "street", a "court", or a "party" wall behind which a neighbour stands.

    The neighbour's wall covers the party wall up to the height `covered`.
    """

    kind: str
    covered: float = 0.0


@dataclass(frozen=True)
class Lot:
    """A rectangle for one building, between (x, z) and (x + width, z + depth), and what stands on it."""

    x: float
    z: float
    width: float
    depth: float
    look: str
    storeys: int  # above the ground floor
    roof: str  # "flat", "mansard" or "hipped"
    sides: tuple[Side, Side, Side, Side]  # towards +z, +x, -z, -x

    @property
    def eave(self) -> float:
        """Height of the top of the walls in metres above the pavement."""
        look = LOOKS[self.look]
        return look.ground + self.storeys * look.storey + (0.5 + PARAPET if self.roof == "flat" else 0.7)


def paint_of(wall: str, rng: np.random.Generator) -> Paint:
    """Return colours that go with a material of walls, each a little different from those of other buildings."""

    def pick(tones: tuple[tuple[float, float, float], ...]) -> tuple[float, float, float]:
        tone = np.array(tones[rng.integers(len(tones))]) * rng.uniform(0.88, 1.1) + rng.uniform(
            -0.015, 0.015, 3
        )
        r, g, b = np.clip(tone, 0.01, 0.95)
        return float(r), float(g), float(b)

    return Paint(
        pick(WALLS[wall]), pick(TRIMS), pick(FRAMES), pick(ACCENTS), tuple(rng.uniform(0.78, 1.0, 3))
    )


def building(lot: Lot, level: int, rng: np.random.Generator) -> Parts:
    """Return the building on a lot, about the lot's corner, with the pavement at height 0.

    `level` 0 is plain, 3 has all ornament; a wall's window takes about 16, 26, 50 or 80 triangles.
    """
    parts, look = Parts(), LOOKS[lot.look]
    paint = paint_of(look.wall, rng)
    low, high = (0.0, 0.0, 0.0), (lot.width, lot.eave, lot.depth)
    ground = look.grounds[rng.integers(len(look.grounds))]
    streets = [side.kind == "street" for side in lot.sides]
    for number, side in enumerate(lot.sides):
        frame, length = side_frame(number, low, high), side_length(number, low, high)
        if side.kind == "party":
            if lot.eave > side.covered + 1e-6:
                ys = np.array([side.covered, lot.eave])
                parts.grid(look.wall, frame, np.array([0, length]), ys, None, np.multiply(paint.wall, 0.85))
        elif side.kind == "court":
            _court_wall(parts, frame, look, paint, length, lot, rng)
        else:
            mitred = (streets[number - 1], streets[(number + 1) % 4])
            ground_floor(parts, frame, look, paint, length, ground, level, rng, mitred[0])
            _street_wall(parts, frame, look, paint, length, lot, level, rng)
            _ledges(parts, frame, look, paint, length, lot, level, mitred)
    _roof(parts, lot, paint, level, rng)
    return parts


def _court_wall(
    parts: Parts, frame: Frame, look: Look, paint: Paint, length: float, lot: Lot, rng: np.random.Generator
) -> None:
    """Add a wall from the ground to the eave, with plain windows that lie in its plane."""
    count, bay = bays_of(length, 3.4)
    x = (np.arange(count) + 0.5) * bay
    y = np.concatenate([[1.2], look.ground + look.storey * np.arange(lot.storeys) + 1.0])
    low, left = np.meshgrid(y, x - 0.55, indexing="ij")
    rects = np.stack([left, low, left + 1.1, low + 1.5], -1).reshape(-1, 4)
    color = (0.6 * paint.wall[0], 0.6 * paint.wall[1], 0.6 * paint.wall[2])
    pierced_wall(parts, frame, look.wall, (0, length), (0, lot.eave), rects, color)
    panes(parts, frame, rects, 0.0, rng, ("curtain", "dark"), framed=True)


def _street_wall(
    parts: Parts, frame: Frame, look: Look, paint: Paint, length: float, lot: Lot, level: int,
    rng: np.random.Generator,
) -> None:  # fmt: skip
    """Add the storeys above the ground floor, with as much ornament as `level` says."""
    openings = open_wall(parts, frame, look, paint, length, (look.ground, lot.eave), lot.storeys)
    rects = openings.reshape(-1, 4)
    straight = rects.copy()
    if look.arched:
        straight[:, 3] -= (rects[:, 2] - rects[:, 0]) / 2 + 0.05
        arched_heads(parts, frame, look, paint, rects, 4 + 2 * min(level, 2), level > 1)
    reveals(parts, frame, look.wall, straight, look.reveal, paint.wall, top=not look.arched)
    kinds = ("sky", "dark") if look.bars[1] > 2 else ("sky", "curtain", "blind", "dark", "curtain")
    panes(parts, frame, rects, look.reveal, rng, kinds, framed=level < 2)
    if level > 0:
        sills(parts, frame, rects, paint.trim)
    if level > 1:
        bars(parts, frame, rects, look.reveal, look.bars, paint.frame)
        if look.hood and not look.arched:
            hoods(parts, frame, rects, look.hood, paint.trim)
    if level > 2:
        casings(parts, frame, straight, look.reveal, paint.frame)
        if look.surround:
            surrounds(parts, frame, rects, paint.trim)
    if look.balconies and level > 0:
        bay = length / openings.shape[1]
        picked = rng.random(openings.shape[:2]) < (0.3 if look.balconies == "iron" else 0.55)
        if look.balconies == "iron":  # not on every storey, and not over one another at random
            picked &= (rng.random(lot.storeys) < 0.6)[:, None]
        chosen = openings[picked]
        narrow = np.maximum(chosen[:, 2] - chosen[:, 0] - (bay - 0.85), 0) / 2
        chosen = chosen + np.stack([narrow, 0 * narrow - 0.2, -narrow, 0 * narrow], -1)
        if len(chosen):
            balconies(parts, frame, chosen, paint, look.balconies == "solid")
    if look.pilasters:
        pilasters(parts, frame, length, look.bay, (look.ground + 0.2, lot.eave - 1.2), paint.trim)
    if lot.look == "tenement" and length > 8 and rng.random() < 0.6:
        _fire_escape(parts, frame, openings[:, int(rng.integers(openings.shape[1] - 1))], level, paint.tint)


def _fire_escape(parts: Parts, frame: Frame, rects: Float64, level: int, tint: Rgb) -> None:
    """Add iron landings before the openings (S, 4) of a column of windows, and stairs from each to the next."""
    x0, y0, _, _ = rects.T
    zero, iron = 0 * x0, (0.045, 0.04, 0.038)
    left, right, y, out = x0 - 0.4, x0 + 3.6, y0 - 0.35, zero + 1.1
    parts.boxes(
        "painted",
        frame,
        np.stack([left, y - 0.07, zero + 0.02], -1),
        np.stack([right, y, out], -1),
        iron,
        "xXyYZ",
    )
    corners = np.stack([np.stack(c, -1) for c in (
        (left, y, out), (right, y, out), (right, y + 0.95, out), (left, y + 0.95, out))], 1)  # fmt: skip
    uv = np.array([(0, 1), (2, 1), (2, 0), (0, 0)], np.float64)
    parts.quads("railing", frame, corners, tint, uv=np.broadcast_to(uv, (*corners.shape[:2], 2)))
    for z in (0.35, 0.95):  # the two strings of each flight
        low, high = (
            np.stack([left[:-1] + 0.6, y[:-1], zero[:-1] + z], -1),
            np.stack([right[:-1] - 0.7, y[1:], zero[1:] + z], -1),
        )
        up, deep = np.array([0, 0.22, 0]), np.array([0, 0, 0.05])
        parts.quads(
            "painted", frame, np.stack([low + deep, high + deep, high + up + deep, low + up + deep], 1), iron
        )
        parts.quads("painted", frame, np.stack([high, low, low + up, high + up], 1), iron)
        parts.quads(
            "painted", frame, np.stack([low + up + deep, high + up + deep, high + up, low + up], 1), iron
        )
        parts.quads("painted", frame, np.stack([low, high, high + deep, low + deep], 1), iron)
    steps = 4 + 3 * level
    t = (np.arange(steps) + 0.5) / steps
    for k in range(len(y) - 1):
        x = left[k] + 0.6 + t * (right[k] - 1.3 - left[k])
        at = np.stack([x, y[k] + 0.1 + t * (y[k + 1] - y[k]), 0 * x + 0.4], -1)
        parts.boxes(
            "painted", frame, at - np.array([0.12, 0.02, 0]), at + np.array([0.12, 0.02, 0.55]), iron, "xXyY"
        )


def _profile(kind: str, y: float) -> list[tuple[float, float]]:
    """Return the profile (z, y) of a ledge whose lower edge is at height `y`."""
    if kind == "plain":
        return [(0.0, y), (0.1, y), (0.1, y + 0.35), (0.0, y + 0.38)]
    if kind == "bracketed":
        return [
            (0.0, y),
            (0.08, y),
            (0.08, y + 0.45),
            (0.55, y + 0.5),
            (0.6, y + 0.72),
            (0.68, y + 0.8),
            (0.0, y + 0.9),
        ]
    return [(0.0, y), (0.12, y + 0.05), (0.16, y + 0.2), (0.36, y + 0.34), (0.4, y + 0.5), (0.0, y + 0.56)]


def _ledges(
    parts: Parts, frame: Frame, look: Look, paint: Paint, length: float, lot: Lot, level: int,
    mitred: tuple[bool, bool],
) -> None:  # fmt: skip
    """Add the band above the ground floor and the cornice; they end a finger's breadth before the neighbours."""
    ends = (0.0 if mitred[0] else 0.02, length - (0.0 if mitred[1] else 0.02))
    y = look.ground
    band = [(0.0, y - 0.15), (0.14, y - 0.15), (0.14, y + 0.1), (0.0, y + 0.16)]
    parts.moulding("painted", frame, ends, band, paint.trim, mitred)
    foot = lot.eave - (1.15 if lot.roof == "flat" else 0.95)
    parts.moulding("painted", frame, ends, _profile(look.crown, foot), paint.trim, mitred)
    if look.crown == "bracketed" and level > 0:
        count = int(length / 0.9)
        x = (np.arange(count) + 0.5) * length / count
        low = np.stack([x - 0.1, 0 * x + foot + 0.05, 0 * x + 0.08], -1)
        parts.boxes("painted", frame, low, low + np.array([0.2, 0.4, 0.34]), paint.trim, "xXyZ")


def _roof(parts: Parts, lot: Lot, paint: Paint, level: int, rng: np.random.Generator) -> None:
    low, high = (0.0, 0.0, 0.0), (lot.width, lot.eave, lot.depth)
    if lot.roof != "flat":
        _sloped_roof(parts, lot, paint, level, rng)
        return
    deck(parts, low, high, paint.wall, paint.trim)
    y = lot.eave - PARAPET
    if lot.look == "works":
        along = np.linspace(2.5, lot.width - 2.5, max(2, int(lot.width / 3.4)))
        skylights(parts, np.stack([along, 0 * along + lot.depth * 0.5], -1), y, (1.8, lot.depth * 0.5))
    else:
        x, z = lot.width * rng.uniform(0.3, 0.5), lot.depth * rng.uniform(0.3, 0.5)
        hut(parts, (x - 1.4, y, z - 1.7), (x + 1.4, y + 2.5, z + 1.7), paint.wall)


def _sloped_roof(parts: Parts, lot: Lot, paint: Paint, level: int, rng: np.random.Generator) -> None:
    """Add a mansard or hipped roof that slopes towards streets and courts, with dormers and chimneys."""
    low, high = (0.0, 0.0, 0.0), (lot.width, lot.eave, lot.depth)
    look, tone = LOOKS[lot.look], TONES[rng.integers(len(TONES))]
    open_sides = [side.kind != "party" for side in lot.sides]
    extent = min(
        span / max(1, open_sides[a] + open_sides[b]) for span, a, b in ((lot.width, 1, 3), (lot.depth, 0, 2))
    )
    mansard = lot.roof == "mansard"
    inset = 1.1 if mansard else min(extent, 5.0)
    rise = 2.9 if mansard else 0.62 * inset
    sloped(parts, low, high, open_sides, look.wall, paint.wall, np.multiply(tone, paint.tint), inset, rise)
    for number, side in enumerate(lot.sides if mansard else ()):
        if side.kind == "street":
            length = side_length(number, low, high)
            count, bay = bays_of(length, look.bay)
            all_bays = np.linspace(bay / 2, length - bay / 2, count)
            middle = all_bays[(all_bays > 1.9) & (all_bays < length - 1.9)][:: 2 if level < 2 else 1]
            if len(middle):
                frame = replace(side_frame(number, low, high), wall=False)
                dormers(parts, frame, middle, lot.eave + 0.35, paint, level, rng)
    for x in (1.0, lot.width - 1.0):
        z = lot.depth * (0.5 if inset < extent else rng.uniform(0.35, 0.65))
        chimney(parts, (x, z), lot.eave + 0.3, lot.eave + rise + rng.uniform(0.9, 1.4), (0.7, 1.5), level)


def tower(size: tuple[float, float], storeys: tuple[int, ...], level: int, rng: np.random.Generator) -> Parts:
    """Return a tower of glass about the middle of its foot: tiers of `storeys`, each smaller than the one below."""
    parts = Parts()
    paint = replace(paint_of("concrete", rng), frame=(0.2, 0.22, 0.24))
    half, y = np.array(size) / 2, 0.0
    for tier, count in enumerate(storeys):
        base = TOWER.ground if tier == 0 else 0.0
        top = base + count * TOWER.storey + 0.6 + PARAPET
        low, high = (-half[0], y, -half[1]), (half[0], y + top, half[1])
        for number in range(4):
            frame, length = side_frame(number, low, high), side_length(number, low, high)
            if base:
                ground_floor(parts, frame, TOWER, paint, length, "lobby", level, rng)
            openings = open_wall(parts, frame, TOWER, paint, length, (base, top), count)
            rects = openings.reshape(-1, 4)
            reveals(parts, frame, "painted", rects, TOWER.reveal, (0.25, 0.27, 0.3))
            panes(parts, frame, rects, TOWER.reveal, rng, ("sky", "sky", "sky", "blind", "dark"))
            _fins(parts, frame, openings, (base, top), paint, level)
            for foot in (base - 0.1, top - 0.5) if base else (top - 0.5,):
                parts.moulding(
                    "painted", frame, (0, length), _profile("plain", foot), paint.trim, (True, True)
                )
        deck(parts, low, high, paint.wall, paint.trim)
        y, half = y + top - PARAPET, half - 2.6
    house = (half[0] * 0.7, 4.5, half[1] * 0.6)
    frame_low = (-house[0], y - 0.05, -house[2])
    parts.boxes("concrete", side_frame(0, frame_low, frame_low), (0, 0, -2 * house[2]), (2 * house[0], house[1], 0),
                (0.4, 0.41, 0.42), "xXYzZ")  # fmt: skip
    return parts


def _fins(
    parts: Parts, frame: Frame, openings: Float64, heights: tuple[float, float], paint: Paint, level: int
) -> None:
    """Add upright fins between the bays of a curtain wall, and a ledge under each storey."""
    x = np.concatenate([[0.15], (openings[0, 1:, 0] + openings[0, :-1, 2]) / 2, [openings[0, -1, 2] + 0.05]])
    low = np.stack([x - 0.06, 0 * x + heights[0] + 0.3, 0 * x], -1)
    high = np.stack([x + 0.06, 0 * x + heights[1] - 0.5, 0 * x + 0.3], -1)
    parts.boxes("painted", frame, low, high, paint.frame, "xXyYZ")
    if level > 1:
        rects = openings.reshape(-1, 4)
        bars(parts, frame, rects, TOWER.reveal, (0, 1), paint.frame)
