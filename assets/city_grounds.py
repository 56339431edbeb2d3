"""Ground floors: shops with glass, lit signs and awnings, doors with steps, arcades, the lobby of a tower."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from assets.city_facades import (
    Look,
    Paint,
    Rgb,
    arched_heads,
    bars,
    bays_of,
    casings,
    panes,
    pierced_wall,
    reveals,
    sills,
)
from assets.city_parts import Frame, Parts
from assets.noise import Float64

SIGNS = (
    (0.9, 0.25, 0.1),
    (0.1, 0.55, 0.75),
    (0.95, 0.7, 0.15),
    (0.2, 0.65, 0.25),
    (0.75, 0.2, 0.5),
    (1, 1, 0.9),
)
CLOTHS = ((0.5, 0.03, 0.03), (0.02, 0.2, 0.09), (0.03, 0.08, 0.3), (0.6, 0.3, 0.02), (0.25, 0.25, 0.25))
GOODS = ((0.6, 0.3, 0.1), (0.15, 0.3, 0.5), (0.5, 0.12, 0.12), (0.5, 0.5, 0.42), (0.2, 0.4, 0.15))
DOOR = (1.3, 2.5)
"""Width and height of a house's door."""


def ground_floor(
    parts: Parts, frame: Frame, look: Look, paint: Paint, length: float, kind: str, level: int,
    rng: np.random.Generator, corner: bool = False,
) -> None:  # fmt: skip
    """Add the wall of a ground floor of one of the kinds "shops", "flats", "arches", "lobby".

    `corner` says that its left end is the corner of two streets, where the shop around the corner has its window.
    """
    if kind == "shops":
        _shops(parts, frame, look, paint, length, level, rng, corner)
    else:
        {"flats": _flats, "arches": _arches, "lobby": _lobby}[kind](
            parts, frame, look, paint, length, level, rng
        )


def _shops(
    parts: Parts, frame: Frame, look: Look, paint: Paint, length: float, level: int, rng: np.random.Generator,
    corner: bool,
) -> None:  # fmt: skip
    count, bay = bays_of(length, 4.6)
    middle = (np.arange(count) + 0.5) * bay
    half, head = bay / 2 - 0.4, look.ground - 1.15
    # The niche of a shop is deep: at a corner it would meet that of the other side, and so a door is there.
    entry = 0 if corner else int(rng.integers(count)) if count > 1 else -1
    shop = np.arange(count) != entry
    windows = np.stack([middle - half, 0 * middle + 0.5, middle + half, 0 * middle + head], -1)[shop]
    doors = np.stack([middle - 0.75, 0 * middle, middle + 0.75, 0 * middle + head], -1)[~shop]
    color = np.multiply(paint.wall, 0.9)
    pierced_wall(
        parts, frame, look.wall, (0, length), (0, look.ground), np.concatenate([windows, doors]), tuple(color)
    )
    _display(parts, frame, windows, level, paint.tint, rng)
    for rect in doors:
        _door(parts, frame, paint, rect, level)
    for x in middle[shop]:
        left, right = x - half - 0.1, x + half + 0.1
        tone = tuple(np.multiply(SIGNS[rng.integers(len(SIGNS))], paint.tint))
        low, high = (left, head + 0.12, 0), (right, head + 0.72, 0.16)
        lit = rng.random() < 0.35
        parts.boxes("sign" if lit else "painted", frame, low, high, tone if lit else paint.accent, "xXyYZ")
        if not lit and level > 1:
            _letters(parts, frame, (left + 0.3, right - 0.3, head + 0.25), tone, rng)
        if rng.random() < 0.5:
            cloth = tuple(np.multiply(CLOTHS[rng.integers(len(CLOTHS))], paint.tint))
            _awning(parts, frame, (left, right), head + 0.1, cloth, 2 + 5 * min(level, 2))


def _display(
    parts: Parts, frame: Frame, rects: Float64, level: int, tint: Rgb, rng: np.random.Generator
) -> None:
    """Add niches behind openings (N, 4), with goods on their floors and panes of clear glass before them."""
    depth = 1.7
    x0, y0, x1, y1 = rects.T
    reveals(parts, frame, "painted", rects, depth, (0.62, 0.55, 0.44))
    z = 0 * x0 - depth
    corners = [np.stack(c, -1) for c in ((x0, y0, z), (x1, y0, z), (x1, y1, z), (x0, y1, z))]
    parts.quads("painted", frame, np.stack(corners, 1), (0.75, 0.6, 0.42))
    low = np.stack([x0 + 0.5, y1 - 0.1, 0 * x0 - 0.9], -1)
    parts.boxes("sign", frame, low, np.stack([x1 - 0.5, y1 - 0.04, 0 * x0 - 0.7], -1), tint, "xXyzZ")
    for x, y, right in zip(x0, y0, x1, strict=True):
        count = int((right - x) * (0.8 if level < 2 else 1.6))
        at = x + 0.35 + (right - x - 0.7) * (np.arange(count) + 0.5) / max(1, count)
        size = rng.uniform(0.12, 0.28, (count, 3)) * [1, 3, 1]
        deep = -rng.uniform(0.45, 1.3, count)
        a = np.stack([at - size[:, 0], 0 * at + y, deep - size[:, 2]], -1)
        b = np.stack([at + size[:, 0], y + size[:, 1], deep + size[:, 2]], -1)
        tones = np.array(GOODS)[rng.integers(len(GOODS), size=count)]
        parts.boxes("painted", frame, a, b, tones, "xXYZ")
    z = 0 * x0 - 0.12
    corners = [np.stack(c, -1) for c in ((x0, y0, z), (x1, y0, z), (x1, y1, z), (x0, y1, z))]
    parts.quads("glass", frame, np.stack(corners, 1), tint)
    if level:
        bars(parts, frame, rects, 0.115, (2, 0), (0.05, 0.05, 0.05))
        sills(parts, frame, rects, (0.3, 0.28, 0.25))


def _letters(
    parts: Parts,
    frame: Frame,
    at: tuple[float, float, float],
    color: tuple[float, ...],
    rng: np.random.Generator,
) -> None:
    """Add blocks that stand for raised letters, from at[0] to at[1] at height at[2]."""
    count = int(rng.integers(4, 8))
    width = min(0.3, (at[1] - at[0]) / (1.5 * count))
    start = (at[0] + at[1]) / 2 - 0.75 * width * count
    x = start + 1.5 * width * np.arange(count)
    tall = rng.choice([0.22, 0.34], count)
    low = np.stack([x, 0 * x + at[2], 0 * x + 0.16], -1)
    parts.boxes(
        "painted", frame, low, low + np.stack([0 * x + width, tall, 0 * x + 0.05], -1), color, "xXyYZ"
    )


def _awning(
    parts: Parts, frame: Frame, ends: tuple[float, float], y: float, color: tuple[float, ...], stripes: int
) -> None:
    """Add a striped awning that slopes down from the wall, with a valance at its front."""
    x = np.linspace(*ends, stripes + 1)
    tone = np.where((np.arange(stripes) % 2 == 0)[:, None], color, (0.7, 0.68, 0.6))
    rows = [(y, 0.17), (y - 0.35, 0.9), (y - 0.55, 1.35), (y - 0.8, 1.36)]
    faces, tones = [], []
    for (top, back), (low, front) in pairwise(rows):
        line = [
            np.stack([x[:-1], 0 * x[:-1] + h, 0 * x[:-1] + z], -1) for h, z in ((low, front), (top, back))
        ]
        right = [np.stack([x[1:], 0 * x[1:] + h, 0 * x[1:] + z], -1) for h, z in ((low, front), (top, back))]
        faces.append(np.stack([line[0], right[0], right[1], line[1]], 1))
        tones.append(tone)
    parts.quads("cloth", frame, np.concatenate(faces), np.concatenate(tones))


def _door(parts: Parts, frame: Frame, paint: Paint, rect: Float64, level: int) -> None:
    """Add the leaf of a door in a recess, with raised panels and a light above it."""
    x0, y0, x1, y1 = rect
    depth, light = 0.35, min(y1 - 0.1, y0 + 2.3)
    opening = rect[None]
    reveals(parts, frame, "painted", opening, depth, paint.trim)
    z = -depth
    leaf = np.array([[(x0, y0, z), (x1, y0, z), (x1, light, z), (x0, light, z)]])
    parts.quads("painted", frame, leaf, paint.accent)
    fan = np.array([[x0, light, x1, y1]])
    panes(parts, frame, fan, depth, np.random.default_rng(0), ("dark",))
    parts.boxes("painted", frame, (x0, light - 0.04, z), (x1, light + 0.04, z + 0.08), paint.trim, "yYZ")
    if level:
        w = (x1 - x0) / 2
        for column in range(2):
            for low, high in ((0.2, 0.9), (1.05, 2.0)):
                a = (x0 + column * w + 0.12, y0 + low, z)
                b = (x0 + (column + 1) * w - 0.12, min(light - 0.1, y0 + high), z + 0.04)
                parts.boxes("painted", frame, a, b, np.multiply(paint.accent, 0.8), "xXyYZ")


def _flats(
    parts: Parts, frame: Frame, look: Look, paint: Paint, length: float, level: int, rng: np.random.Generator
) -> None:
    count, bay = bays_of(length, look.bay)
    middle = (np.arange(count) + 0.5) * bay
    entry = int(rng.integers(count))
    wide = look.share * bay / 2
    rects = np.stack([middle - wide, 0 * middle + 1.3, middle + wide, 0 * middle + look.ground - 0.9], -1)
    steps = 0.45
    door = np.array([middle[entry] - DOOR[0] / 2, steps, middle[entry] + DOOR[0] / 2, steps + DOOR[1]])
    rects = np.delete(rects, entry, axis=0)
    everything = np.concatenate([rects, door[None]])
    pierced_wall(parts, frame, look.wall, (0, length), (0, look.ground), everything, paint.wall)
    _door(parts, frame, paint, door, level)
    x0, _, x1, _ = door
    for k in range(3):
        low, high = (x0 - 0.25, 0, 0.35 * (2 - k)), (x1 + 0.25, steps * (k + 1) / 3, 0.35 * (3 - k))
        parts.boxes("painted", frame, low, high, (0.42, 0.4, 0.37), "xXYZ")
    parts.boxes(
        "painted", frame, (x0 - 0.3, door[3] + 0.1, 0), (x1 + 0.3, door[3] + 0.28, 0.7), paint.trim, "xXyYZ"
    )
    if len(rects):
        reveals(parts, frame, look.wall, rects, look.reveal, paint.wall)
        panes(parts, frame, rects, look.reveal, rng, ("curtain", "blind", "dark"), framed=not level)
        if level:
            sills(parts, frame, rects, paint.trim)
            bars(parts, frame, rects, look.reveal, (1, 1), paint.frame)
    plinth = [(0, -0.05), (0.09, -0.05), (0.09, 0.75), (0, 0.84)]
    for ends in ((0.02, x0 - 0.27), (x1 + 0.27, length - 0.02)):
        if ends[1] - ends[0] > 0.3:
            parts.moulding("painted", frame, ends, plinth, np.multiply(paint.trim, 0.7))


def _arches(
    parts: Parts, frame: Frame, look: Look, paint: Paint, length: float, level: int, rng: np.random.Generator
) -> None:
    count, bay = bays_of(length, look.bay)
    middle = (np.arange(count) + 0.5) * bay
    wide = min(0.34 * bay, 1.5)
    low = np.where(np.arange(count) == count // 2, 0.0, 0.9)
    rects = np.stack([middle - wide, low, middle + wide, 0 * middle + look.ground - 0.35], -1)
    spring = rects[:, 3] - wide - 0.05
    cut = np.concatenate([np.stack([rects[:, 0], low, rects[:, 2], spring], -1),
                          np.stack([rects[:, 0], spring, rects[:, 2], rects[:, 3]], -1)])  # fmt: skip
    pierced_wall(parts, frame, look.wall, (0, length), (0, look.ground), cut, paint.wall)
    straight = rects.copy()
    straight[:, 3] = spring
    reveals(parts, frame, look.wall, straight, look.reveal, paint.wall, top=False)
    arched_heads(parts, frame, look, paint, rects, 4 + 4 * min(level, 2), level > 0)
    panes(parts, frame, rects, look.reveal, rng, ("dark", "sky"), framed=not level)
    if level:
        casings(parts, frame, straight, look.reveal, paint.frame)
        bars(parts, frame, rects, look.reveal, (2, 2), paint.frame)
        sills(parts, frame, rects[low > 0], paint.trim)
    if level > 1:  # courses of cut stone between the arches
        edges = np.concatenate([[0.0], np.stack([rects[:, 0], rects[:, 2]], 1).ravel(), [length]])
        for y in np.arange(0.35, float(spring.min()) - 0.4, 0.55):
            a = np.stack([edges[::2] + 0.06, 0 * edges[::2] + y, 0 * edges[::2]], -1)
            b = np.stack([edges[1::2] - 0.06, 0 * edges[1::2] + y + 0.47, 0 * edges[1::2] + 0.06], -1)
            parts.boxes(look.wall, frame, a, b, paint.wall, "xXyYZ")


def _lobby(
    parts: Parts, frame: Frame, look: Look, paint: Paint, length: float, level: int, rng: np.random.Generator
) -> None:
    count, bay = bays_of(length, 5.0)
    left = np.arange(count) * bay
    rects = np.stack([left + 0.45, 0 * left + 0.05, left + bay - 0.45, 0 * left + look.ground - 0.7], -1)
    pierced_wall(parts, frame, look.wall, (0, length), (0, look.ground), rects, paint.wall)
    reveals(parts, frame, look.wall, rects, 0.4, paint.trim)
    panes(parts, frame, rects, 0.4, rng, ("sky",))
    bars(parts, frame, rects, 0.4, (3, 1), paint.frame)
    if level:
        canopy = count // 2
        low, high = (left[canopy], look.ground - 1.4, 0), (left[canopy] + bay, look.ground - 1.2, 2.2)
        parts.boxes("painted", frame, low, high, paint.accent, "xXyYZ")
