"""The grid of froxels from above, and its slices in depth."""

from __future__ import annotations

import math

from tools.site.figures.canvas import Canvas, Point

COLUMNS, SLICES = 10, 9
"""Of the view from above."""
NEAR, FAR = 0.06, 1.0
HALF_ANGLE = math.radians(36)
SCALE, EYE = 300.0, (250.0, 336.0)
"""Pixels of the far depth, and the place of the eye in the drawing."""

RULER, LONG = 16, 620.0
"""Slices of the rulers, and the length of a ruler in pixels."""
RULER_NEAR, RULER_FAR = 0.01, 2.0
"""The defaults of fog_near and fog_far, in length scales."""


def end_of(index: int, count: int, near: float, far: float) -> float:
    """Return the depth at which a slice ends; -1 is the eye, at which the first one begins."""
    return 0.0 if index < 0 else near * (far / near) ** ((index + 1) / count)


def froxels_from_above() -> Canvas:
    """Columns and slices of a frustum, with one froxel and the lookup of a surface."""
    c = Canvas(
        760, 366, "Froxels from above: columns of a frustum, cut by slices whose depths have a constant ratio"
    )

    def at(column: float, depth: float) -> Point:
        across = (2 * column / COLUMNS - 1) * math.tan(HALF_ANGLE) * depth
        return EYE[0] + SCALE * across, EYE[1] - SCALE * depth

    ends = [end_of(i, SLICES, NEAR, FAR) for i in range(-1, SLICES)]
    chosen = (6, 6)
    for column, index in (chosen, (2, 3)):
        corners = [
            at(column, ends[index]),
            at(column + 1, ends[index]),
            at(column + 1, ends[index + 1]),
            at(column, ends[index + 1]),
        ]
        c.polygon(corners, "b", "line")
    for depth in ends[1:]:
        c.line([at(0, depth), at(COLUMNS, depth)], "line", 1)
    for column in range(COLUMNS + 1):
        c.line([EYE, at(column, FAR)], "line", 1)
    c.circle(*EYE, 5, "ink", "ink")
    c.text(EYE[0] + 14, EYE[1] + 4, "eye", 12)
    ratio = (FAR / NEAR) ** (1 / SLICES)
    middle = at(chosen[0] + 0.5, (ends[chosen[1]] + ends[chosen[1] + 1]) / 2)
    c.circle(*middle, 4, "mark", "mark")
    c.line([(500, 84), (middle[0] + 7, middle[1])], "mark", 1, arrow=True)
    c.text(506, 88, "a froxel with its sample", 12, role="mark")
    for number, words in enumerate(
        (
            f"{COLUMNS} columns, {SLICES} slices; the grid has 128 and 64.",
            f"A slice ends {ratio:.2f} times as far away as the last,",
            "so a froxel grows and keeps its shape.",
            "The first slice begins at the eye.",
        )
    ):
        c.note(420, 236 + 20 * number, words)
    return c


def slices_in_depth() -> Canvas:
    """Rulers of even and of exponential slices, and the first slices with places for a sample."""
    c = Canvas(
        760,
        330,
        "Depths of slices: even steps, exponential slices from near on, and the first slice from the eye on with its "
        "sample",
    )
    even = [RULER_FAR * i / RULER for i in range(RULER + 1)]
    ends = [end_of(i, RULER, RULER_NEAR, RULER_FAR) for i in range(-1, RULER)]
    rulers = (
        (f"{RULER} slices of equal thickness", even, RULER_FAR, RULER),
        (f"{RULER} exponential slices, near {RULER_NEAR:g}, far {RULER_FAR:g}", ends, RULER_FAR, RULER),
        ("the first three of them, enlarged", ends, ends[3], 3),
    )
    for number, (title, depths, far, count) in enumerate(rulers):
        y = 24.0 + 88 * number
        c.text(20, y, title, 13, bold=True)
        for index in range(count):
            left, right = (20 + LONG * depth / far for depth in depths[index : index + 2])
            fill = ("a", "card")[index % 2]
            c.rectangle((left, y + 12, right - left, 30), fill, "line", False, 0)
        c.text(20, y + 58, "0", 11, role="soft")
        c.text(20 + LONG, y + 58, f"{far:.3g} length scales", 11, "end", "soft")
    right = ends[1] / 2
    wrong = RULER_NEAR * (RULER_FAR / RULER_NEAR) ** (0.5 / RULER)
    y = 24.0 + 88 * 2 + 27
    for depth, role in ((right, "s3"), (wrong, "mark")):
        c.circle(20 + LONG * depth / ends[3], y, 5, role, role)
    c.circle(26, 294, 5, "s3", "s3")
    c.note(40, 298, "sample of the first slice: half of its end")
    c.circle(386, 294, 5, "mark", "mark")
    c.note(400, 298, "the place by ratio, which lies next to its end")
    c.note(
        20,
        320,
        "Slices of equal thickness lie mostly far away, where all is small.",
    )
    return c
