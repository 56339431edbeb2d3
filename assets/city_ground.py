"""What the city stands on: carriageways, crossings, pavements, courts, squares, parks, the land around, and the sky.

Pieces meet edge to edge, and none lies over another. Where two of them meet, both have the same points, or one of them
goes on below the other.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from assets.city_facades import pierced_wall
from assets.city_parts import OBJECT, Frame, Parts
from assets.city_plan import BLOCK, CORNER, DEPTH, KERB, PAVEMENT
from assets.noise import Float64
from assets.shapes import Mesh, surface

ROUND = 3.0
"""Radius of a pavement's corners."""

LEVEL = Frame(np.zeros(3), np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]]), wall=False)
"""The ground as a wall that faces up: its y is -z."""

ROAD, GUTTER, LINE = (0.13, 0.13, 0.135), (0.085, 0.085, 0.09), (0.72, 0.72, 0.7)
SLABS, KERBSTONE, GRAVEL, LAWN = (0.52, 0.5, 0.47), (0.6, 0.58, 0.55), (0.62, 0.52, 0.4), (0.2, 0.34, 0.1)
DEEP = 0.2
"""How far kerbs and edges go on below the ground beside them, so that no gap can show."""


def _arc(steps: int, radius: float) -> Float64:
    """Return offsets (steps + 1, 2) from the centre of a rounded corner: from -x to -z."""
    angle = np.linspace(np.pi, 1.5 * np.pi, steps + 1)
    offsets = radius * np.stack([np.cos(angle), np.sin(angle)], -1)
    offsets[0], offsets[-1] = (-radius, 0.0), (0.0, -radius)
    return offsets


def _loop(inset: float, steps: int) -> Float64:
    """Return a rounded rectangle (4 * (steps + 1), 2) around a block, `inset` metres inside its kerb's outer edge.

    It runs from the corner at least x and z to that at most x and least z.
    """
    low, high = -PAVEMENT, np.array(BLOCK) + PAVEMENT
    arc = _arc(steps, ROUND - inset)
    centers = [
        (low + ROUND, low + ROUND),
        (high[0] - ROUND, low + ROUND),
        (high[0] - ROUND, high[1] - ROUND),
        (low + ROUND, high[1] - ROUND),
    ]
    turns = [((1, 0), (0, 1)), ((0, -1), (1, 0)), ((-1, 0), (0, -1)), ((0, 1), (-1, 0))]
    return np.concatenate(
        [arc @ np.array(turn, np.float64).T + center for turn, center in zip(turns, centers, strict=True)]
    )


def pavement(fine: bool) -> Parts:
    """Return the pavement around a block and its kerb; its top is at height 0, and the block's corner the origin."""
    parts = Parts()
    steps = 6 if fine else 2
    outer, inner = _loop(0.0, steps), _loop(0.3, steps)
    corners = np.array([(0.0, 0.0), (BLOCK[0], 0.0), BLOCK, (0.0, BLOCK[1])]).repeat(steps + 1, axis=0)

    def at(loop: Float64, y: float) -> Float64:
        return np.insert(loop, 1, y, axis=1)

    def strip(outside: Float64, inside: Float64) -> Float64:
        return np.stack([outside, inside, np.roll(inside, -1, 0), np.roll(outside, -1, 0)], 1)

    kerb = strip(at(outer, 0.0), at(inner, 0.0))
    face = strip(at(outer, -KERB - DEEP), at(outer, 0.0))
    parts.quads("concrete", OBJECT, np.concatenate([kerb, face]), KERBSTONE)
    shade = np.array([1.0, 0.72, 0.72, 1.0])[:, None] * SLABS  # less sky is seen from the foot of a wall
    walk = strip(at(inner, 0.0), at(corners, 0.0))
    parts.quads("paving", OBJECT, walk, np.broadcast_to(shade, (len(walk), 4, 3)))
    return parts


def _across(width: float, fine: bool) -> Float64:
    """Return lines across a carriageway, about its middle: gutters, stripes of a crossing, the middle line."""
    half = width / 2
    stripes = np.linspace(-half + 0.5, half - 0.5, round(width) if fine else 2)  # a metre wide
    return np.unique(np.round([-half, -0.09, 0.09, half, *stripes], 6))


def _cells(parts: Parts, xs: Float64, zs: Float64, tone: Float64) -> None:
    """Add level cells of asphalt between lines, coloured by `tone` (R, C, 3)."""
    low_x, low_z = np.meshgrid(xs[:-1], zs[:-1])
    high_x, high_z = np.meshgrid(xs[1:], zs[1:])
    zero = 0 * low_x
    corners = [(low_x, zero, high_z), (high_x, zero, high_z), (high_x, zero, low_z), (low_x, zero, low_z)]
    faces = np.stack([np.stack(corner, -1) for corner in corners], -2)
    parts.quads("asphalt", OBJECT, faces.reshape(-1, 4, 3), tone.reshape(-1, 3))


def street(length: float, width: float, fine: bool) -> Parts:
    """Return a carriageway along z about the origin, with a crossing for walkers at both ends and a broken line."""
    parts = Parts()
    xs, half = _across(width, fine), length / 2
    inner = half - 5.0
    dashes = np.linspace(-inner, inner, 2 * round(inner / 3) + 2) if fine else np.array([-inner, inner])
    zs = np.unique(np.round([-half, -half + 1, -half + 4, half - 4, half - 1, half, *dashes], 6))
    x, z = (xs[1:] + xs[:-1]) / 2, (zs[1:] + zs[:-1]) / 2
    tone = np.broadcast_to(ROAD, (len(z), len(x), 3)).copy()
    tone[:, np.abs(x) > width / 2 - 0.5] = GUTTER
    if fine:
        stripe = np.floor(x + width / 2 - 0.5).astype(np.int64) % 2 == 0
        walk = (np.abs(z) > half - 4) & (np.abs(z) < half - 1)
        tone[np.ix_(walk, stripe & (np.abs(x) < width / 2 - 0.5))] = LINE
        dashed = np.isin(np.arange(len(z)), np.flatnonzero(np.abs(z) < inner)[::2])
        tone[np.ix_(dashed, np.abs(x) < 0.09)] = LINE
    _cells(parts, xs, zs, tone)
    return parts


def crossing(width_x: float, width_z: float, fine: bool) -> Parts:
    """Return where a street along z, `width_x` wide, meets one along x, as far as the round corners reach."""
    parts = Parts()
    xs, zs = _across(width_x, fine), _across(width_z, fine)
    end_x, end_z = width_x / 2 + ROUND, width_z / 2 + ROUND
    for lines_x, lines_z in (
        (xs, zs), (xs, np.array([-end_z, zs[0]])), (xs, np.array([zs[-1], end_z])),
        (np.array([-end_x, xs[0]]), zs), (np.array([xs[-1], end_x]), zs),
    ):  # fmt: skip
        tone = np.broadcast_to(ROAD, (len(lines_z) - 1, len(lines_x) - 1, 3))
        _cells(parts, lines_x, lines_z, tone)
    arc = _arc(6 if fine else 2, ROUND)
    fans = []
    for sx, sz in ((1, 1), (-1, 1), (-1, -1), (1, -1)):
        rim = (arc + np.array([end_x, end_z])) * [sx, sz]
        rim = np.insert(rim if sx * sz > 0 else rim[::-1], 1, 0.0, axis=1)
        apex = np.broadcast_to([sx * width_x / 2, 0.0, sz * width_z / 2], rim[1:].shape)
        fans.append(np.stack([apex, rim[:-1], rim[1:], apex], 1))
    parts.quads("asphalt", OBJECT, np.concatenate(fans), GUTTER)
    return parts


def court(yards: tuple[bool, bool]) -> Parts:
    """Return the ground between the rows of a block, which reaches the street where there is a yard, with its wall."""
    parts = Parts()
    near, far = DEPTH, BLOCK[1] - DEPTH
    left, right = (0.0 if yards[0] else CORNER), BLOCK[0] - (0.0 if yards[1] else CORNER)
    xs = np.unique([left, CORNER, CORNER + 3, BLOCK[0] - CORNER - 3, BLOCK[0] - CORNER, right])
    ys = -np.array([far, far - 3, near + 3, near])
    lawn = np.zeros((3, len(xs) - 1), bool)
    middle = (xs[1:] + xs[:-1]) / 2
    lawn[1] = (middle > CORNER + 3) & (middle < BLOCK[0] - CORNER - 3)
    parts.grid("paving", LEVEL, xs, ys, lawn, np.multiply(SLABS, 0.7))
    parts.grid("grass", LEVEL, xs, ys, ~lawn, np.multiply(LAWN, 0.78 + 0.03 * yards[0] + 0.06 * yards[1]))
    for is_yard, x in zip(yards, (0.0, BLOCK[0] - 0.35), strict=True):
        if is_yard:  # a wall with a gap for a gate
            middle_z, inset = BLOCK[1] / 2, 0.02
            low = [(x + inset, -DEEP, near + inset), (x + inset, -DEEP, middle_z + 1.6)]
            high = [(x + 0.35 - inset, 2.6, middle_z - 1.6), (x + 0.35 - inset, 2.6, far - inset)]
            parts.boxes("brick", OBJECT, np.array(low), np.array(high), (0.5, 0.3, 0.22), "xXYzZ")
    return parts


def paved(feet: Sequence[tuple[float, float, float, float]]) -> Parts:
    """Return a paved square in place of houses, open where a building stands: on rectangles x0, z0, x1, z1."""
    parts = Parts()
    holes = np.array([(x0, -z1, x1, -z0) for x0, z0, x1, z1 in feet]).reshape(-1, 4)
    pierced_wall(parts, LEVEL, "paving", (0.0, BLOCK[0]), (-BLOCK[1], 0.0), holes, (0.6, 0.55, 0.48))
    return parts


PATHS_X = np.array([0.0, 2.5, 24.0, 28.5, 31.5, 36.0, 57.5, 60.0])
PATHS_Z = np.array([0.0, 2.5, 16.0, 20.5, 23.5, 28.0, 41.5, 44.0])


def park() -> Parts:
    """Return lawns between paths and a round of gravel in the middle."""
    parts = Parts()
    lawn = np.zeros((7, 7), bool)
    lawn[1:6, 1:6] = True
    lawn[2:5, 2:5] = lawn[3] = lawn[:, 3] = False
    parts.grid("paving", LEVEL, PATHS_X, -PATHS_Z[::-1], lawn, GRAVEL)
    parts.grid("grass", LEVEL, PATHS_X, -PATHS_Z[::-1], ~lawn, LAWN)
    return parts


def land(half: Float64, reach: float) -> Parts:
    """Return the meadow around the city, a finger's breadth below the road, and a metre under its edge."""
    parts = Parts()
    y, inside = -0.03, half - 1.0
    rings = [inside, inside + 0.25 * (reach - inside), np.full(2, reach)]
    signs = np.array([(-1, 1), (1, 1), (1, -1), (-1, -1)])
    for near, far in pairwise(rings):
        a, b = (np.insert(signs * size, 1, y, axis=1) for size in (far, near))
        faces = np.stack([a, np.roll(a, -1, 0), np.roll(b, -1, 0), b], 1)
        parts.quads("grass", OBJECT, faces, (0.19, 0.22, 0.11))
    return parts


def dome(radius: float) -> Mesh:
    """Return half a sphere seen from inside, which begins below the ground; its picture goes around twice."""
    columns, rows, edge = 32, 8, 1 / 256
    around = np.linspace(0.0, 2 * np.pi, columns + 1)
    x, z = -np.sin(around), np.cos(around)
    x[-1], z[-1] = x[0], z[0]
    elevation = np.radians(np.linspace(90.0, 0.0, rows + 1))[:, None]
    across, up = np.cos(elevation), np.sin(elevation)
    across[0] = 0.0
    points = radius * np.stack(np.broadcast_arrays(across * x, up, across * z), -1)
    points[-1, :, 1] = -0.5
    u, v = np.linspace(0.0, 2.0, columns + 1), np.linspace(edge, 1.0 - edge, rows + 1)[:, None]
    normals = -points / np.linalg.norm(points, axis=-1, keepdims=True)
    return surface(points, np.stack(np.broadcast_arrays(u, v), -1), normals).without_tangents()
