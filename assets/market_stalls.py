"""Stalls of the night market: frames of posts and planks, counters, awnings; poles, and wires.

A stall's own frame has its front along x at z = 0, looks towards +z, and has its middle at x = 0.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from assets.city_parts import OBJECT, Parts
from assets.market_plan import KNOTS, MAST_TOP, MAST_X, MAST_Z, Pole, String, head_place
from assets.shapes import Mesh, join, lathe, surface, tube

COUNTER_TOP, COUNTER = 0.9, (-0.78, -0.06)
"""Height of the counter, and where it ends behind and before, along z."""

SHELVES, SHELF = (0.55, 1.02, 1.5), (-2.02, -1.68)
"""Heights of the tops of the shelves at the back, and where they end along z."""

STEP_TOP, STEP = 1.12, (-1.1, -0.78)
"""The step behind the counter."""

IRON = (0.05, 0.05, 0.055)
AWNINGS = (
    ((0.62, 0.06, 0.05), (0.78, 0.7, 0.58)), ((0.04, 0.22, 0.42), (0.76, 0.72, 0.62)),
    ((0.08, 0.34, 0.2), (0.8, 0.74, 0.5)), ((0.78, 0.42, 0.06), (0.7, 0.16, 0.05)),
    ((0.45, 0.07, 0.28), (0.78, 0.5, 0.42)), ((0.05, 0.32, 0.36), (0.82, 0.62, 0.3)),
    ((0.7, 0.62, 0.5), (0.62, 0.52, 0.4)), ((0.22, 0.08, 0.34), (0.72, 0.46, 0.12)),
)  # fmt: skip
"""Linear colours of the stripes of each awning."""


def frame(tone: float, tiers: bool) -> Parts:
    """Return posts, beams, counter and, with `tiers`, the shelves; `tone` brightens or darkens the wood."""
    parts, color = Parts(), np.array([1.0, 0.93, 0.85]) * tone
    x, front, back = MAST_X, -MAST_Z, -2.1

    def box(a: Sequence[float], b: Sequence[float], faces: str) -> None:
        """Add a box with the faces that can be seen."""
        parts.boxes("wood", OBJECT, a, b, color, faces)

    for side in (-x, x):
        box((side - 0.035, 0.0, front - 0.035), (side + 0.035, MAST_TOP + 0.03, front + 0.035), "xXYzZ")
        box((side - 0.035, 0.0, back - 0.035), (side + 0.035, 2.66, back + 0.035), "xXzZ")
        box((side - 0.025, 2.1, back + 0.035), (side + 0.025, 2.17, front - 0.035), "xXyY")
    box((-x - 0.02, 2.17, -0.48), (x + 0.02, 2.22, -0.42), "yYzZ")
    box((-x - 0.02, 2.17, -1.53), (x + 0.02, 2.22, -1.47), "yYzZ")
    box((-1.43, COUNTER_TOP - 0.05, COUNTER[0]), (1.43, COUNTER_TOP, COUNTER[1]), "xXyYzZ")
    box((-1.4, 0.06, COUNTER[0] + 0.06), (1.4, COUNTER_TOP - 0.05, COUNTER[1] - 0.06), "xXyzZ")
    for rail in (0.2, 0.62):
        box((-1.4, rail, COUNTER[1] - 0.06), (1.4, rail + 0.07, COUNTER[1] - 0.03), "xXyYZ")
    box((-1.36, 0.04, STEP[0]), (1.36, STEP_TOP, STEP[1]), "xXYzZ")
    if tiers:
        box((-1.42, 0.08, -2.07), (1.42, 1.98, -2.03), "xXYzZ")
        for top in SHELVES:
            box((-1.4, top - 0.03, SHELF[0] - 0.01), (1.4, top, SHELF[1]), "xXyYZ")
        for side in (-1.4, 1.36):
            box((side, 0.0, SHELF[0] - 0.01), (side + 0.04, SHELVES[0] - 0.03, SHELF[1] - 0.02), "xXZ")
            for below, above in pairwise(SHELVES):
                box((side, below, SHELF[0] - 0.01), (side + 0.04, above - 0.03, SHELF[1] - 0.02), "xXZ")
    else:
        box((-1.3, 0.0, -2.0), (0.9, 0.5, -1.62), "xXYzZ")
    return parts


def awning(style: int) -> Parts:
    """Return a striped sheet from the back posts over the front to a scalloped edge, with the bar that holds it."""
    parts, stripes, rows = Parts(), 10, 3
    colors = np.array(AWNINGS[style % len(AWNINGS)])
    x = np.linspace(-1.66, 1.66, stripes + 1)
    down = np.linspace(0.0, 1.0, rows + 1)
    z, y = -2.18 + 2.78 * down, 2.72 - 0.5 * down - 0.22 * down * (1.0 - down) * (style % 2)
    edge = [np.stack([x, 0 * x + level, 0 * x + out], -1) for level, out in zip(y, z, strict=True)]
    for left, right in ((edge[k], edge[k + 1]) for k in range(rows)):
        corners = np.stack([right[:-1], right[1:], left[1:], left[:-1]], 1)
        parts.quads("awning", OBJECT, corners, colors[np.arange(stripes) % 2], uv=2.0 * corners[..., [0, 2]])
    top, middle = edge[-1], (edge[-1][1:] + edge[-1][:-1]) / 2
    short, long = np.array([0.0, -0.13, 0.02]), np.array([0.0, -0.24, 0.03])
    for a, b, c, d in (
        (top[:-1] + short, middle + long, middle, top[:-1]),
        (middle + long, top[1:] + short, top[1:], middle),
    ):
        corners = np.stack([a, b, c, d], 1)
        parts.quads("awning", OBJECT, corners, colors[np.arange(stripes) % 2], uv=2.0 * corners[..., :2])
    bar, post = 2.19, np.array([0.02, 0.02, 0.0])
    parts.boxes("painted", OBJECT, (-1.62, bar - 0.02, 0.53), (1.62, bar + 0.01, 0.56), IRON, "xXyYzZ")
    ends = np.array([[(side, 1.72, -MAST_Z + 0.03), (side, bar - 0.01, 0.54)] for side in (-1.5, 1.5)])
    for low, high in ends:  # the struts from the masts to the bar
        parts.quads("painted", OBJECT, np.array([
            [low - post, low + post * (1, -1, 0), high + post * (1, -1, 0), high - post],
            [low + post * (1, -1, 0), low + post, high + post, high + post * (1, -1, 0)],
            [low + post, low + post * (-1, 1, 0), high + post * (-1, 1, 0), high + post],
            [low + post * (-1, 1, 0), low - post, high - post, high + post * (-1, 1, 0)],
        ]), IRON)  # fmt: skip
    return parts


def pole(kind: Pole) -> Parts:
    """Return a pole about its foot, with an arm and a hood for each of its heads."""
    parts, top = Parts(), kind.top + 0.42
    shaft = lathe([[(0.035, top), (0.06, 0.9)], [(0.06, 0.9), (0.13, 0.75), (0.14, 0.1), (0.2, 0.0)]], 8)
    parts.add("painted", shaft.painted(IRON), lathe([[(0.0, top + 0.1), (0.07, top)]], 8).painted(IRON))
    for target in kind.targets:
        x, y, z = np.subtract(head_place(kind, target), (kind.x, 0.0, kind.z))
        path = np.array(
            [(0.0, top - 0.12, 0.0), (0.6 * x, top - 0.02, 0.6 * z), (x, top - 0.1, z), (x, y + 0.16, z)]
        )
        parts.add("painted", tube(path, 0.022, 5).painted(IRON))
    return parts


def hood() -> Parts:
    """Return the head of a pole: a bell around its light, which shines along -z, and the glowing disc in it."""
    turned = np.array([[1.0, 0, 0], [0, 0, -1.0], [0, 1.0, 0]])  # +y to +z
    profile = [(0.03, 0.2), (0.09, 0.12), (0.17, 0.0)]
    outside = lathe([profile], 10).painted(IRON)
    inside = lathe([[(0.165, -0.0), (0.085, 0.11)]], 10).painted((0.5, 0.48, 0.42))
    disc = _disc(0.15, 0.03, 10).painted((1.0, 1.0, 1.0))
    parts = Parts()
    parts.add("painted", outside.turned(turned), inside.turned(turned))
    parts.add("head", disc.turned(turned))
    return parts


def _disc(radius: float, y: float, sides: int) -> Mesh:
    """Return a disc that is seen from below."""
    angle = np.linspace(0.0, 2 * np.pi, sides + 1)
    rim = np.stack([radius * np.sin(angle), 0 * angle + y, radius * np.cos(angle)], -1)
    points = np.stack([rim, np.broadcast_to([0.0, y, 0.0], rim.shape)])
    return surface(points, points[..., [0, 2]], np.broadcast_to([0.0, -1.0, 0.0], points.shape))


def wires(strings: Sequence[String]) -> Parts:
    """Return the wires of several strings, in the world."""
    parts = Parts()
    meshes = [tube(string.points(KNOTS), 0.008, 3) for string in strings]
    parts.add("painted", join(*meshes).painted((0.02, 0.02, 0.022)))
    return parts
