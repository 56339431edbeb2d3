"""Motion vectors as colours: a pan, a turning box before a ground at rest, and the vectors of the closest of 3x3."""

from __future__ import annotations

import colorsys
import math
from collections.abc import Callable

from tools.site.figures.canvas import Canvas

Vector = tuple[float, float]

SIDE = 14
"""Pixels along each edge of a panel."""
PAN: Vector = (1.0, 0.0)
MIDDLE, HALF, TILT = 6.5, 3.4, 0.35
"""Of the box: its place and half of its edge in pixels, and how far it is turned."""
RATE = 0.24
"""Radians of a frame, clockwise in the picture."""
LONGEST = RATE * HALF * math.sqrt(2)


def inside(x: int, y: int) -> bool:
    """Whether a pixel shows the box."""
    right, down = x - MIDDLE, y - MIDDLE
    along = right * math.cos(TILT) + down * math.sin(TILT)
    across = down * math.cos(TILT) - right * math.sin(TILT)
    return max(abs(along), abs(across)) <= HALF


def turning(x: int, y: int) -> Vector:
    """Return the vector of a pixel in pixels: place now minus place before, of a box that turns."""
    if not inside(x, y):
        return 0.0, 0.0
    right, down = x - MIDDLE, y - MIDDLE
    cosine, sine = math.cos(-RATE), math.sin(-RATE)
    return right - (cosine * right - sine * down), down - (sine * right + cosine * down)


def closest(x: int, y: int) -> Vector:
    """Return the vector that a pixel follows: its own on the box, else that of the first pixel of the box in 3x3."""
    if inside(x, y):
        return turning(x, y)
    around = [(x + right, y + down) for down in (-1, 0, 1) for right in (-1, 0, 1)]
    return next((turning(*at) for at in around if inside(*at)), (0.0, 0.0))


def color(vector: Vector, longest: float) -> str:
    """Return a colour: its hue is the direction, and its saturation the length; grey is no motion."""
    length = min(math.hypot(*vector) / longest, 1.0)
    hue = math.atan2(vector[1], vector[0]) / math.tau % 1.0
    red, green, blue = colorsys.hls_to_rgb(hue, 0.62, length)
    return "#" + "".join(f"{round(255 * part):02x}" for part in (red, green, blue))


def vectors_as_colours() -> Canvas:
    """Three panels of pixels, with arrows on some of them."""
    c = Canvas(
        760, 320, "Motion vectors as colours: a pan, a turning box, and the vector that each pixel follows"
    )
    cell, top = 15.0, 46.0
    panels: tuple[tuple[str, Callable[[int, int], Vector], float], ...] = (
        ("a pan", lambda x, y: PAN, 1.0),
        ("a box that turns", turning, LONGEST),
        ("the closest of 3x3", closest, LONGEST),
    )
    for number, (title, of, longest) in enumerate(panels):
        left = 24.0 + 244 * number
        c.text(left, 28, title, 13, bold=True)
        for y in range(SIDE):
            for x in range(SIDE):
                fill = color(of(x, y), longest)
                c.raw(
                    f'<rect x="{left + cell * x:.1f}" y="{top + cell * y:.1f}" width="{cell}" height="{cell}" '
                    f'fill="{fill}" stroke="#71717a" stroke-width="0.3"/>'
                )
        for y in range(2, SIDE - 1, 3):
            for x in range(2, SIDE - 1, 3):
                vector = of(x, y)
                if math.hypot(*vector) > 0.1 * longest:
                    at = left + cell * (x + 0.5), top + cell * (y + 0.5)
                    way = [1.9 * cell * part / longest for part in vector]
                    c.raw(
                        f'<path d="M{at[0] - way[0] / 2:.1f} {at[1] - way[1] / 2:.1f}l{way[0]:.1f} {way[1]:.1f}" '
                        f'stroke="#18181b" stroke-width="1.6"/>'
                    )
                    c.raw(
                        f'<circle cx="{at[0] + way[0] / 2:.1f}" cy="{at[1] + way[1] / 2:.1f}" r="2.6" fill="#18181b"/>'
                    )
    c.note(24, 280, "hue: direction; saturation: length; grey: exactly 0; the dot is the place now")
    c.note(
        24,
        302,
        "on the right the first row of pixels outside the box has vectors of the box, so its edge is found",
    )
    return c
