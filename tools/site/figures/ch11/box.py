"""Colours of 3x3 pixels in a plane of luma and orange against blue, their boxes, and a history outside of them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tools.site.figures.canvas import Canvas, Point

NINE = np.array(
    [
        (0.30, 0.02),
        (0.34, 0.05),
        (0.37, 0.03),
        (0.40, 0.07),
        (0.42, 0.06),
        (0.45, 0.09),
        (0.47, 0.07),
        (0.50, 0.10),
        (0.86, 0.16),
    ]
)
"""Luma and Co of nine pixels; one of them is a highlight."""
HISTORY = np.array((0.74, 0.31))
GAMMA = 1.0

Float64 = NDArray[np.float64]


def extremes() -> tuple[Float64, Float64]:
    """Return the lower and the upper corner of the box of the nine."""
    return NINE.min(axis=0), NINE.max(axis=0)


def variance() -> tuple[Float64, Float64]:
    """Return the corners of the box of mean +- deviations."""
    mean, reach = NINE.mean(axis=0), GAMMA * NINE.std(axis=0)
    return mean - reach, mean + reach


def clipped(point: Float64, low: Float64, high: Float64) -> Float64:
    """Return where the way from the middle of a box to a point leaves it; the point, if it is inside."""
    middle, half = (low + high) / 2, (high - low) / 2
    moved: Float64 = middle + (point - middle) / max(float((np.abs(point - middle) / half).max()), 1.0)
    return moved


def boxes_of_colours() -> Canvas:
    """Two panels: the box of the extremes, and that of the variance."""
    c = Canvas(
        760,
        330,
        "Colours of 3x3 pixels in a plane of luminance and colour, with two boxes, and a history brought into them",
    )
    wide, tall, top = 330.0, 220.0, 46.0
    panels = (("clamp and clip to the extremes", extremes()), ("clip to mean ± deviation", variance()))
    for number, (title, (low, high)) in enumerate(panels):
        left = 30.0 + 366 * number

        def at(point: Float64, left: float = left) -> Point:
            return left + wide * (float(point[0]) - 0.2) / 0.75, top + tall * (
                1 - (float(point[1]) + 0.04) / 0.4
            )

        c.text(left, 28, title, 13, bold=True)
        c.rectangle((left, top, wide, tall), "card", "line", False, 0)
        (x0, y1), (x1, y0) = at(low), at(high)
        c.rectangle((x0, y0, x1 - x0, y1 - y0), "a", "line", False, 0)
        for pixel in NINE:
            c.circle(*at(pixel), 3.5, "s1", "s1")
        c.line([at((low + high) / 2), at(HISTORY)], "line", 1.5, dashed=True)
        c.circle(*at(HISTORY), 6, "s2", "s2")
        c.text(at(HISTORY)[0] + 10, at(HISTORY)[1] + 4, "history", 12)
        found = clipped(HISTORY, low, high)
        c.circle(*at(found), 6, "paper", "mark")
        c.text(at(found)[0] + 10, at(found)[1] + (18 if number == 0 else 4), "clipped", 12)
        if number == 0:
            pinned = np.clip(HISTORY, low, high)
            c.circle(*at(pinned), 5, "mark", "mark")
            c.text(at(pinned)[0] - 9, at(pinned)[1] - 8, "clamped", 12, "end")
        c.text(left + wide, top + tall + 18, "luma Y", 11, "end", "soft")
        c.text(left, top + tall + 18, "upwards: Co, orange against blue", 11, role="soft")
    c.note(
        30,
        312,
        "one bright pixel decides how large the box of the extremes is, and hardly moves that of the variance",
    )
    return c
