"""Two levels of acceleration structures: instances in Morton order, their records, and a structure for each mesh."""

from __future__ import annotations

import numpy as np

from chapters.ch12.rays.bvh.build import build
from chapters.ch12.rays.bvh.morton import order
from tools.site.figures.canvas import Canvas

PLACES = np.array(
    [(0.8, 0.75), (0.15, 0.2), (0.9, 0.2), (0.3, 0.85), (0.6, 0.6), (0.35, 0.35), (0.12, 0.62), (0.62, 0.12)]
)
"""Of the instances 0 to 7 on the ground, in parts of its edges."""
MESHES = (0, 1, 0, 1, 0, 1, 1, 0)
HALF = 0.06
"""Half the edge of an instance's box."""


def along_the_curve() -> list[int]:
    """Return the instances in the order of their records."""
    points = np.column_stack([PLACES, np.zeros(len(PLACES))])
    return [int(i) for i in order(points.astype(np.float32))]


def boxes_of_the_top() -> list[tuple[float, float, float, float]]:
    """Return (left, low, right, high) of the boxes of the upper level's inner nodes."""
    low = np.column_stack([PLACES - HALF, np.zeros(len(PLACES))]).astype(np.float32)
    high = np.column_stack([PLACES + HALF, np.full(len(PLACES), 2 * HALF)]).astype(np.float32)
    tree = build(low, high, largest=1)
    inner = tree.children >= 0
    corners = np.concatenate([tree.low[inner][:, :2], tree.high[inner][:, :2]], axis=1)
    return [(float(a), float(b), float(c), float(d)) for a, b, c, d in corners]


def two_levels() -> Canvas:
    """Left the ground with its instances, right the records and what they name."""
    c = Canvas(
        760, 400, "Instances in Morton order, their records in the upper level, and a structure for each mesh"
    )
    side, left, top = 290.0, 24.0, 48.0

    def at(x: float, y: float) -> tuple[float, float]:
        return left + side * x, top + side * (1 - y)

    c.text(left, 26, "upper level (TLAS): boxes of instances", 13, bold=True)
    c.rectangle((left, top, side, side), "card", "line", False, 0)
    for x0, y0, x1, y1 in boxes_of_the_top():
        (px, py), (qx, qy) = at(x0 - 0.015, y1 + 0.015), at(x1 + 0.015, y0 - 0.015)
        c.raw(
            f'<rect x="{px:.1f}" y="{py:.1f}" width="{qx - px:.1f}" height="{qy - py:.1f}" fill="none" '
            'stroke="var(--f-s1)" stroke-width="1.2"/>'
        )
    ordered = along_the_curve()
    c.line([at(*PLACES[i]) for i in ordered], "s2", 1.2, dashed=True)
    for number, (x, y) in enumerate(PLACES):
        px, py = at(x - HALF, y + HALF)
        c.box(
            px,
            py,
            2 * HALF * side,
            2 * HALF * side,
            str(number),
            "a" if MESHES[number] == 0 else "b",
            13,
            round=2,
        )
    c.note(left, top + side + 22, "dashed: the order of the records (Morton)")
    c.text(350, 26, "records", 13, bold=True)
    for place, number in enumerate(ordered):
        y = top + 36.0 * place
        c.box(
            350,
            y,
            160,
            28,
            f"instance {number}, mask 1, matrix",
            "a" if MESHES[number] == 0 else "b",
            11,
            round=2,
        )
        c.arrow(510, y + 14, 586, 110.0 if MESHES[number] == 0 else 262.0, "line")
    c.text(590, 26, "lower level (BLAS)", 13, bold=True)
    c.box(590, 70, 150, 80, "mesh 0, at rest:\nbuilt once,\ncompacted", "a", 12)
    c.box(590, 222, 150, 80, "mesh 1, deforms:\nrefitted in each\nframe that moves it", "b", 12)
    c.note(350, top + 36.0 * len(ordered) + 20, "Each mesh has one structure in its own space,")
    c.note(350, top + 36.0 * len(ordered) + 38, "however many instances it has.")
    return c
