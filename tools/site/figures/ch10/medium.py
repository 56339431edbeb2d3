"""Parts of a medium along a line upwards, and the ways of light to a froxel."""

from __future__ import annotations

import math
from collections.abc import Callable

from tools.site.figures.canvas import Canvas, Point

CONSTANT, HEIGHT, FALLOFF, BASE = 0.1, 0.5, 1.0, 0.5
"""Extinctions per metre, falloff per metre, and the base of height fog in metres."""
BOX, DENSITY = (1.8, 2.6), 0.35
CONTRAST = 0.5
TOP, MOST = 4.0, 1.0
"""Metres and extinction that a panel shows."""


def constant(_: float) -> float:
    """Return the extinction of the constant part."""
    return CONSTANT


def height(y: float) -> float:
    """Return the extinction of height fog."""
    return HEIGHT * math.exp(-FALLOFF * max(y - BASE, 0.0))


def box(y: float) -> float:
    """Return the extinction of the box."""
    return DENSITY if BOX[0] <= y <= BOX[1] else 0.0


def noise(y: float) -> float:
    """Return the factor of a noise, whose mean is 1: three waves in place of gradient noise."""
    waves = sum(math.sin(math.tau * y * k + 2 * k) / k for k in (1, 2, 4))
    return 1 + CONTRAST * waves / 1.75


def total(y: float) -> float:
    """Return what a froxel gets."""
    return (constant(y) + height(y) + box(y)) * noise(y)


PARTS: tuple[tuple[str, Callable[[float], float]], ...] = (
    ("constant", constant),
    ("height", height),
    ("box", box),
    ("factor of noise", noise),
    ("extinction", total),
)


def parts_of_the_medium() -> Canvas:
    """A panel for each part, with heights upwards."""
    c = Canvas(760, 300, "A column of the medium: constant fog, height fog, a box and noise, and their sum")
    wide, tall, top = 108.0, 200.0, 46.0
    for number, (name, part) in enumerate(PARTS):
        left = 42.0 + 146 * number
        most = 2.0 if part is noise else MOST
        c.text(left, 28, name, 13, bold=True)
        c.rectangle((left, top, wide, tall), "card", "line", False, 0)
        heights = [TOP * i / 200 for i in range(201)]
        points = [(left + wide * part(y) / most, top + tall * (1 - y / TOP)) for y in heights]
        c.line(points, "s1" if number < 4 else "s2", 2.5)
        c.text(left, top + tall + 18, "0", 11, role="soft")
        c.text(
            left + wide, top + tall + 18, f"{most:g}" if part is noise else f"{most:g} / m", 11, "end", "soft"
        )
        if number < 4:
            c.text(left + wide + 19, top + tall / 2 + 5, "+ + x ="[2 * number], 16, "middle", bold=True)
    c.text(34, top + 8, "4 m", 11, "end", "soft")
    c.text(34, top + tall, "0", 11, "end", "soft")
    c.note(
        42, 288, "(constant + height + box) x noise; scattering is the same sum, each part times its albedo"
    )
    return c


def ways_of_light() -> Canvas:
    """A froxel, a lamp, a box of fog, height fog, and the sun at the bounds of the scene."""
    c = Canvas(
        760,
        330,
        "Light on its way to a froxel: through height fog and a box from a lamp, and from the sun to the box around "
        "the scene",
    )
    left, top, wide, tall = 40.0, 54.0, 420.0, 236.0
    c.text(40, 28, "two ways, without a march", 13, bold=True)
    c.rectangle((left, top, wide, tall), "paper", "ink", True, 0)
    c.rectangle((left, top + tall - 120, wide, 50), "card", "card", False, 0)
    c.rectangle((left, top + tall - 70, wide, 70), "d", "d", False, 0)
    c.rectangle((250, 150, 90, 62), "a", "line", False, 0)
    c.text(295, 168, "box", 12, "middle")
    froxel: Point = (150.0, 222.0)
    lamp: Point = (420.0, 158.0)
    c.line([lamp, (froxel[0] + 9, froxel[1] - 2)], "s2", 2, arrow=True)
    c.circle(*lamp, 7, "b", "s2")
    c.text(420, 144, "lamp", 12, "middle")
    edge: Point = (246.0, top)
    c.line([(271, 24), edge], "s2", 2, dashed=True)
    c.line([edge, (froxel[0] + 3, froxel[1] - 9)], "s2", 2, arrow=True)
    c.text(280, 30, "sun", 12)
    c.circle(*edge, 5, "mark", "mark")
    c.rectangle((froxel[0] - 8, froxel[1] - 8, 16, 16), "b", "ink", False, 0)
    c.text(froxel[0] - 16, froxel[1] + 4, "froxel", 12, "end")
    c.text(48, 282, "height fog, up to its base", 12)
    c.text(48, top + 18, "box around the scene", 12, role="soft")
    lines = (
        ("length x sum of (extinction x mean)", True),
        ("constant: the mean is 1", False),
        ("height: the part below the base,", False),
        ("and an exponential above", False),
        ("box: the part of the way inside", False),
        ("noise: its mean, 1", False),
    )
    for number, (words, bold) in enumerate(lines):
        c.text(476, 96 + 24 * number, words, 12, bold=bold, role="ink" if bold else "soft")
    c.circle(482, 254, 5, "mark", "mark")
    c.note(496, 258, "here the way to the sun ends")
    return c
