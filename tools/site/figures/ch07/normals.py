"""The sphere's directions in the square of the octahedral code, and what three codes of a normal lose."""

from __future__ import annotations

import math
from functools import cache

import numpy as np
from numpy.typing import NDArray

from tools.site.figures.canvas import Canvas, Point

Float64 = NDArray[np.float64]

CELL = 15
"""Degrees of longitude and latitude of a cell of the sphere."""
DIRECTIONS = 200_000


def octahedral(n: Float64) -> Float64:
    """Return the code (..., 2), from -1 to 1, of unit vectors (..., 3): see shaders/octahedral.glsl."""
    p = n[..., :2] / np.abs(n).sum(axis=-1, keepdims=True)
    folded = (1 - np.abs(p[..., ::-1])) * np.where(p >= 0, 1, -1)
    return np.where(n[..., 2:] < 0, folded, p)


def direction(code: Float64) -> Float64:
    """Return the unit vectors (..., 3) of codes (..., 2)."""
    z = 1 - np.abs(code).sum(axis=-1, keepdims=True)
    xy = code - np.maximum(-z, 0) * np.where(code >= 0, 1, -1)
    n = np.concatenate([xy, z], axis=-1)
    return np.asarray(n / np.linalg.norm(n, axis=-1, keepdims=True))


@cache
def errors() -> dict[str, tuple[float, float, int]]:
    """Return of each way to store a normal the largest and the mean turn in degrees, and its bytes."""
    random = np.random.default_rng(7)
    n = random.normal(size=(DIRECTIONS, 3))
    n /= np.linalg.norm(n, axis=1, keepdims=True)
    ten = (np.round(n * 511 + 512) - 512) / 511
    half = n.astype(np.float16).astype(np.float64)
    short = direction(np.round(octahedral(n) * 32767) / 32767)
    found = {}
    for name, back, size in (
        ("3 x 10 bits", ten, 4),
        ("3 halves", half, 8),
        ("2 x 16 bits, octahedral", short, 4),
    ):
        back = back / np.linalg.norm(back, axis=1, keepdims=True)
        # Of the chord between unit vectors, which is exact for small angles.
        turn = np.degrees(2 * np.arcsin(np.linalg.norm(back - n, axis=1) / 2))
        found[name] = float(turn.max()), float(turn.mean()), size
    return found


def cells() -> list[tuple[Float64, Float64, str]]:
    """Return cells of the sphere: unit vectors (4, 3), their codes (4, 2), and the colour of their octant."""
    found = []
    for up in range(-90, 90, CELL):
        for around in range(0, 360, CELL):
            corners = np.radians(
                [(around + dx, up + dy) for dx, dy in ((0, 0), (CELL, 0), (CELL, CELL), (0, CELL))]
            )
            long, lat = corners.T
            n = np.stack([np.cos(lat) * np.cos(long), np.cos(lat) * np.sin(long), np.sin(lat)], axis=-1)
            # A corner on the edge of an octant has the code of its own cell's octant.
            middle = n.mean(axis=0)
            code = octahedral(n + 1e-9 * (middle - n))
            quarter = around // 90
            found.append((n, code, "abcd"[quarter] if up >= 0 else "ef"[quarter % 2]))
    return found


def octahedral_normals() -> Canvas:
    """A sphere in cells, the same cells in the square of the code, and what three ways to store a normal lose."""
    c = Canvas(
        760,
        316,
        "The directions of the sphere in the square of the octahedral code, and the errors of three codes",
    )
    turn, tilt = math.radians(-28), math.radians(22)
    right = np.array([math.cos(turn), math.sin(turn), 0])
    toward = np.array([math.cos(tilt) * math.sin(turn), -math.cos(tilt) * math.cos(turn), math.sin(tilt)])
    up = np.cross(toward, right)
    x, y, radius = 122.0, 160.0, 106.0
    left, top, half = 256.0, 54.0, 106.0

    def on_sphere(n: Float64) -> Point:
        return x + radius * float(n @ right), y - radius * float(n @ up)

    def on_square(code: Float64) -> Point:
        return left + half * (1 + float(code[0])), top + half * (1 - float(code[1]))

    for n, code, fill in cells():
        if float(n.mean(axis=0) @ toward) > 0:
            c.polygon([on_sphere(one) for one in n], fill, "line")
        c.polygon([on_square(one) for one in code], fill, "line")
    for one, words in (((1, 0, 0), "+x"), ((0, -1, 0), "-y"), ((0, 0, 1), "+z")):
        px, py = on_sphere(np.array(one, np.float64))
        c.circle(px, py, 3, "ink", "ink")
        c.text(px + 7, py - 5, words, 13, bold=True)
    axes = (
        ((0.0, 0.0), "+z"),
        ((1.0, 0.0), "+x"),
        ((-1.0, 0.0), "-x"),
        ((0.0, 1.0), "+y"),
        ((0.0, -1.0), "-y"),
    )
    corners = tuple(((sx, sy), "-z") for sx in (-1.0, 1.0) for sy in (-1.0, 1.0))
    for place, words in (*axes, *corners):
        px, py = on_square(np.array(place))
        c.circle(px, py, 3, "ink", "ink")
        if words == "-z":
            c.text(px, py + (-6 if place[1] > 0 else 17), words, 13, "middle", bold=True)
        elif place[0] == 0:
            c.text(px + 7, py + (-6 if place[1] >= 0 else 17), words, 13, bold=True)
        else:
            c.text(px + 6 * place[0], py + 5, words, 13, "start" if place[0] > 0 else "end", bold=True)
    shown = np.array([0.45, -0.72, -0.53])
    shown /= np.linalg.norm(shown)
    for px, py in (on_sphere(shown), on_square(octahedral(shown))):
        c.circle(px, py, 5, "mark", "paper")
    c.text(16, 26, "the sphere")
    c.text(left, 26, "the square")
    c.note(16, 288, "upper half: the inner diamond;")
    c.note(16, 305, "lower half: triangles, folded out")
    c.note(left, 305, "red: the same direction", "mark")
    c.text(516, 26, "stored and read: the largest turn")
    most = max(largest for largest, _, _ in errors().values())
    for row, (name, (largest, mean, size)) in enumerate(errors().items()):
        py = 54.0 + 76 * row
        c.text(516, py + 10, f"{name}: {size} bytes", 12, bold=row == 2)
        c.box(516, py + 18, 200 * largest / most, 18, "", "ab"[row == 2], round=0)
        c.note(516, py + 52, f"{largest:.4f} degrees, on average {mean:.4f}")
    c.note(516, 288, f"of {DIRECTIONS:,} random directions;")
    c.note(516, 305, "a mirror shows twice the turn")
    return c
