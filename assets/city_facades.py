"""Facades: walls with window openings, reveals, panes, bars, sills and hoods, balconies, ground floors with shops."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from assets.city_parts import Frame, Parts
from assets.noise import Float64

WHITE = (1.0, 1.0, 1.0)
PANES = {"sky": (0, 1), "curtain": (2, 3), "blind": (4, 5), "dark": (6, 7)}
"""Cells of the picture of window panes, which has 4 x 4 of them; those in its lower half have painted bars."""

Rgb = tuple[float, float, float]


@dataclass(frozen=True)
class Look:
    """What the facades of a kind of building have in common; lengths in metres.

    A window takes `share` of the width of its bay, and reaches from `sill` to `head` of the height of its storey.
    """

    wall: str
    bay: float
    share: float
    sill: float
    head: float
    storey: float
    ground: float
    reveal: float = 0.22
    bars: tuple[int, int] = (1, 1)
    arched: bool = False
    surround: bool = False
    hood: str = ""
    pilasters: bool = False
    balconies: str = ""
    crown: str = "cornice"
    grounds: tuple[str, ...] = ("shops", "flats")


@dataclass(frozen=True)
class Paint:
    """The colours of one building, linear rgb; `tint` is near white and multiplies those of pictures and of glass."""

    wall: Rgb
    trim: Rgb
    frame: Rgb
    accent: Rgb
    tint: Rgb = WHITE


def bays_of(length: float, aim: float) -> tuple[int, float]:
    """Return how many bays a wall has, and their width."""
    count = max(1, round(length / aim))
    return count, length / count


def open_wall(
    parts: Parts,
    frame: Frame,
    look: Look,
    paint: Paint,
    length: float,
    heights: tuple[float, float],
    storeys: int,
) -> Float64:
    """Add a wall between two heights with a row of openings in each storey; return the openings (S, B, 4).

    An opening is x0, y0, x1, y1. The wall's top above the last storey is closed.
    """
    count, bay = bays_of(length, look.bay)
    middle = (np.arange(count) + 0.5) * bay
    left, right = middle - look.share * bay / 2, middle + look.share * bay / 2
    floor = heights[0] + look.storey * np.arange(storeys)
    low, high = floor + look.sill * look.storey, floor + look.head * look.storey
    spring = high - (right[0] - left[0]) / 2 - 0.05
    rows = [low, spring, high] if look.arched else [low, high]
    xs = np.concatenate([[0.0], np.stack([left, right], 1).ravel(), [length]])
    ys = np.concatenate([[heights[0]], np.stack(rows, 1).ravel(), [heights[1]]])
    open_rows = np.arange(len(ys) - 1) % len(rows) != 0
    holes = open_rows[:, None] & (np.arange(len(xs) - 1) % 2 == 1)
    parts.grid(look.wall, frame, xs, ys, holes, paint.wall)
    shape = (storeys, count)
    return np.stack([np.broadcast_to(v, shape) for v in (left, low[:, None], right, high[:, None])], axis=-1)


def pierced_wall(
    parts: Parts, frame: Frame, material: str, span: tuple[float, float], heights: tuple[float, float],
    rects: Float64, color: Rgb,
) -> None:  # fmt: skip
    """Add a wall with any openings (N, 4) that do not overlap; its lines run through, so that no edge is split."""
    rects = np.round(rects * 4096) / 4096
    xs = np.unique([*span, *rects[:, [0, 2]].ravel()])
    ys = np.unique([*heights, *rects[:, [1, 3]].ravel()])
    x, y = (xs[1:] + xs[:-1]) / 2, (ys[1:] + ys[:-1]) / 2
    x0, y0, x1, y1 = rects.T[:, :, None]
    inside_x, inside_y = (x > x0) & (x < x1), (y > y0) & (y < y1)
    holes = (inside_y[:, :, None] & inside_x[:, None, :]).any(axis=0)
    parts.grid(material, frame, xs, ys, holes, color)


def reveals(
    parts: Parts, frame: Frame, material: str, rects: Float64, depth: float, color: Rgb, top: bool = True
) -> None:
    """Add the inner sides of openings (N, 4): left, right, bottom and `top`."""
    x0, y0, x1, y1 = rects.T
    front, back = np.zeros_like(x0), np.full_like(x0, -depth)
    sides = [
        [(x0, y0, front), (x0, y0, back), (x0, y1, back), (x0, y1, front)],
        [(x1, y0, back), (x1, y0, front), (x1, y1, front), (x1, y1, back)],
        [(x0, y0, front), (x1, y0, front), (x1, y0, back), (x0, y0, back)],
        [(x0, y1, back), (x1, y1, back), (x1, y1, front), (x0, y1, front)],
    ]
    corners = np.concatenate([_faces(side) for side in sides[: 4 if top else 3]])
    parts.quads(material, frame, corners, color)


def panes(
    parts: Parts, frame: Frame, rects: Float64, depth: float, rng: np.random.Generator, kinds: tuple[str, ...],
    framed: bool = False,
) -> None:  # fmt: skip
    """Add glass at `depth` behind the wall in openings (N, 4); each shows one of `kinds` at random.

    `framed` takes the pictures on which bars are painted, for windows that have none.
    """
    x0, y0, x1, y1 = rects.T
    z = np.full_like(x0, -depth)
    corners = _faces([(x0, y0, z), (x1, y0, z), (x1, y1, z), (x0, y1, z)])
    cells = np.array([cell for kind in kinds for cell in PANES[kind]])
    cell = cells[rng.integers(len(cells), size=len(rects))] + 8 * framed
    at = np.stack([cell % 4, cell // 4], -1)[:, None, :]
    inside = np.array([(0.03, 0.97), (0.97, 0.97), (0.97, 0.03), (0.03, 0.03)])
    parts.quads("window", frame, corners, WHITE, uv=(at + inside) / 4.0)


def bars(
    parts: Parts, frame: Frame, rects: Float64, depth: float, count: tuple[int, int], color: Rgb
) -> None:
    """Add `count` upright and level glazing bars before panes (N, 4) at `depth`; bars that cross differ in depth."""
    x0, y0, x1, y1 = rects.T
    half = 0.03
    for k in range(count[0]):
        x = x0 + (x1 - x0) * (k + 1) / (count[0] + 1)
        low, high = (x - half, y0, 0 * x - depth), (x + half, y1, 0 * x - depth + 0.05)
        parts.boxes("painted", frame, np.stack(low, -1), np.stack(high, -1), color, "xXZ")
    for k in range(count[1]):
        y = y0 + (y1 - y0) * (k + 1) / (count[1] + 1)
        low, high = (x0, y - half, 0 * y - depth), (x1, y + half, 0 * y - depth + 0.035)
        parts.boxes("painted", frame, np.stack(low, -1), np.stack(high, -1), color, "yYZ")


def casings(parts: Parts, frame: Frame, rects: Float64, depth: float, color: Rgb) -> None:
    """Add the frames around panes (N, 4): a bar along each edge, of which two faces are seen."""
    x0, y0, x1, y1 = rects.T
    w, front, level = 0.06, 0 * x0 - depth + 0.06, 0 * x0 - depth + 0.045
    back = 0 * x0 - depth
    for low, high, faces in (
        ((x0, y0, back), (x0 + w, y1, front), "XZ"),
        ((x1 - w, y0, back), (x1, y1, front), "xZ"),
        ((x0, y0, back), (x1, y0 + w, level), "YZ"),
        ((x0, y1 - w, back), (x1, y1, level), "yZ"),
    ):
        parts.boxes("painted", frame, np.stack(low, -1), np.stack(high, -1), color, faces)


def arch_points(rects: Float64, steps: int) -> tuple[Float64, Float64]:
    """Return x and y (N, steps + 1) of the round heads of openings, from left to right; each is just below its rect."""
    x0, _, x1, y1 = rects.T
    radius, angle = (x1 - x0) / 2, np.linspace(np.pi, 0.0, steps + 1)
    x = (x0 + x1)[:, None] / 2 + radius[:, None] * np.cos(angle)
    y = (y1 - radius - 0.05)[:, None] + radius[:, None] * np.sin(angle)
    x[:, 0], x[:, -1], y[:, -1] = x0, x1, y[:, 0]
    return x, y


def arched_heads(
    parts: Parts, frame: Frame, look: Look, paint: Paint, rects: Float64, steps: int, ring: bool
) -> None:
    """Fill the corners above the round heads of openings (N, 4), line the heads, and put a raised ring around each."""
    x0, _, x1, y1 = rects.T
    x, y = arch_points(rects, steps)
    flat = np.zeros_like(x)
    arc = np.stack([x, y, flat], -1)
    half = steps // 2
    left = np.stack([x0, y1, 0 * x0], -1)[:, None].repeat(half, 1)
    right = np.stack([x1, y1, 0 * x0], -1)[:, None].repeat(steps - half, 1)
    pieces = [
        np.stack([left, arc[:, :half], arc[:, 1 : half + 1], left], 2),
        np.stack([right, arc[:, half:-1], arc[:, half + 1 :], right], 2),
        np.stack([left[:, :1], arc[:, half : half + 1], right[:, :1], left[:, :1]], 2),
    ]
    parts.quads(look.wall, frame, np.concatenate([piece.reshape(-1, 4, 3) for piece in pieces]), paint.wall)
    deep = arc - [0, 0, look.reveal]
    soffit = np.stack([deep[:, :-1], deep[:, 1:], arc[:, 1:], arc[:, :-1]], 2)
    parts.quads(look.wall, frame, soffit.reshape(-1, 4, 3), np.multiply(paint.wall, 0.8))
    if ring:
        middle = np.stack([(x0 + x1) / 2, y[:, 0], 0 * x0], -1)[:, None]
        outer = middle + (arc - middle) * 1.22
        out = np.array([0, 0, 0.07])
        faces = [
            np.stack([arc[:, :-1] + out, arc[:, 1:] + out, outer[:, 1:] + out, outer[:, :-1] + out], 2),
            np.stack([outer[:, :-1] + out, outer[:, 1:] + out, outer[:, 1:], outer[:, :-1]], 2),
            np.stack([arc[:, :-1], arc[:, 1:], arc[:, 1:] + out, arc[:, :-1] + out], 2),
            np.stack([outer[:, :1], arc[:, :1], arc[:, :1] + out, outer[:, :1] + out], 2),
            np.stack([arc[:, -1:], outer[:, -1:], outer[:, -1:] + out, arc[:, -1:] + out], 2),
        ]
        parts.quads("painted", frame, np.concatenate([f.reshape(-1, 4, 3) for f in faces]), paint.trim)


def sills(parts: Parts, frame: Frame, rects: Float64, color: Rgb) -> None:
    """Add a sill before the lower edge of openings (N, 4)."""
    x0, y0, x1, _ = rects.T
    low = np.stack([x0 - 0.1, y0 - 0.12, 0 * x0], -1)
    high = np.stack([x1 + 0.1, y0, 0 * x0 + 0.12], -1)
    parts.boxes("painted", frame, low, high, color, "xXyYZ")


def hoods(parts: Parts, frame: Frame, rects: Float64, kind: str, color: Rgb) -> None:
    """Add what crowns openings (N, 4): a "lintel" in the wall, a "ledge" before it, or a "gable"."""
    x0, _, x1, y1 = rects.T
    if kind == "lintel":
        low, high = (x0 - 0.2, y1, 0 * x0), (x1 + 0.2, y1 + 0.28, 0 * x0 + 0.03)
        parts.boxes("painted", frame, np.stack(low, -1), np.stack(high, -1), color, "xXyYZ")
        return
    low, high = (x0 - 0.22, y1 + 0.1, 0 * x0), (x1 + 0.22, y1 + 0.24, 0 * x0 + 0.22)
    parts.boxes("painted", frame, np.stack(low, -1), np.stack(high, -1), color, "xXyYZ")
    if kind == "gable":
        wide, foot, peak, out = 0.12, y1 + 0.24, y1 + 0.24 + 0.22 * (x1 - x0), 0 * x0 + 0.18
        left, right, top = (
            np.stack([x0 - wide, foot, out], -1),
            np.stack([x1 + wide, foot, out], -1),
            np.stack([(x0 + x1) / 2, peak, out], -1),
        )
        back = np.array([0, 0, 0.18])
        front = np.stack([left, right, top, left], 1)
        slope_left = np.stack([left, top, top - back, left - back], 1)
        slope_right = np.stack([right, right - back, top - back, top], 1)
        parts.quads("painted", frame, np.concatenate([front, slope_left, slope_right]), color)


def surrounds(parts: Parts, frame: Frame, rects: Float64, color: Rgb) -> None:
    """Add flat raised bands beside and above openings (N, 4)."""
    x0, y0, x1, y1 = rects.T
    w, z, out = 0.16, 0 * x0, 0 * x0 + 0.05
    for low, high, faces in (
        ((x0 - w, y0, z), (x0, y1, out), "xXyZ"),
        ((x1, y0, z), (x1 + w, y1, out), "xXyZ"),
        ((x0 - w, y1, z), (x1 + w, y1 + w, out), "xXyYZ"),
    ):
        parts.boxes("painted", frame, np.stack(low, -1), np.stack(high, -1), color, faces)


def balconies(parts: Parts, frame: Frame, rects: Float64, paint: Paint, solid: bool) -> None:
    """Add a slab with a railing before openings (N, 4): a pierced one of iron, or a `solid` one with a handrail."""
    x0, y0, x1, _ = rects.T
    left, right, low = x0 - 0.35, x1 + 0.35, y0 - 0.02
    zero, out = 0 * x0, 0 * x0 + 1.05

    def boxes(material: str, a: tuple[Float64, ...], b: tuple[Float64, ...], color: Rgb, faces: str) -> None:
        parts.boxes(material, frame, np.stack(a, -1), np.stack(b, -1), color, faces)

    boxes("painted", (left, low - 0.16, zero), (right, low, out), paint.trim, "xXyYZ")
    for x in (left + 0.15, right - 0.35):
        boxes("painted", (x, low - 0.42, zero), (x + 0.2, low - 0.16, zero + 0.6), paint.trim, "xXyZ")
    edge, top = 0.05, low + 1.0
    if solid:
        boxes("painted", (left, low, out - 0.12), (right, top, out), paint.wall, "xXYzZ")
        boxes("painted", (left, low, zero), (left + 0.12, top, out - 0.12), paint.wall, "xXY")
        boxes("painted", (right - 0.12, low, zero), (right, top, out - 0.12), paint.wall, "xXY")
        return
    ends = [
        (left + edge, out - edge, right - edge, out - edge),
        (left + edge, zero, left + edge, out - edge),
        (right - edge, out - edge, right - edge, zero),
    ]
    for xa, za, xb, zb in ends:
        corners = _faces([(xa, low, za), (xb, low, zb), (xb, top, zb), (xa, top, za)])
        across = np.hypot(xb - xa, zb - za)
        u = np.stack([0 * across, across, across, 0 * across], -1)
        v = np.broadcast_to([1.0, 1.0, 0.0, 0.0], u.shape)
        parts.quads("railing", frame, corners, paint.tint, uv=np.stack([u / 2.0, v], -1))
    boxes("painted", (left, top, out - 0.1), (right, top + 0.05, out), (0.03, 0.03, 0.035), "xXyYzZ")


def pilasters(
    parts: Parts, frame: Frame, length: float, bay: float, heights: tuple[float, float], color: Rgb
) -> None:
    """Add flat pillars with foot and head between the bays of a wall, and at its ends."""
    count, width = bays_of(length, bay)
    x = np.clip(np.arange(count + 1) * width, 0.28, length - 0.28)
    for half, low, high, out in (
        (0.22, heights[0] + 0.5, heights[1] - 0.4, 0.12),
        (0.27, heights[0], heights[0] + 0.5, 0.17),
        (0.27, heights[1] - 0.4, heights[1], 0.17),
    ):
        a = np.stack([x - half, 0 * x + low, 0 * x], -1)
        b = np.stack([x + half, 0 * x + high, 0 * x + out], -1)
        parts.boxes("painted", frame, a, b, color, "xXyYZ" if half > 0.25 else "xXZ")


def _faces(corners: list[tuple[Float64, Float64, Float64]]) -> Float64:
    """Return (N, 4, 3) from four corners of (N,) coordinates."""
    return np.stack([np.stack(corner, -1) for corner in corners], 1)
