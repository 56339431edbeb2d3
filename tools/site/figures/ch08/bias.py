"""The geometry of bias: a tilted surface, what the texels of a shadow map hold of it, and the plane of the receiver."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from tools.site.figures.canvas import Canvas, Point

TILT = math.radians(50.0)
TEXELS = 6
CONSTANT, SLOPE = 1.0, 1.0
"""The defaults of `shadow_constant` and `shadow_slope`."""

Float64 = NDArray[np.float64]


def depth(x: Float64 | float) -> Float64 | float:
    """Return the depth of the surface at `x`; both are in texels."""
    return x * math.tan(TILT)


def stored(x: Float64) -> Float64:
    """Return what the map holds at `x`: the depth at the middle of the texel."""
    return np.asarray(depth(np.floor(x) + 0.5))


def shaded(bias: float, radius: int = 0, plane: bool = False, samples: int = 6000) -> float:
    """Return the mean part of taps that take the surface for shaded, over one texel."""
    x = (np.arange(samples) + 0.5) / samples
    taps = []
    for offset in range(-radius, radius + 1):
        middle = np.floor(x) + offset + 0.5
        receiver = depth(middle) if plane else depth(x)
        taps.append(stored(x + offset) < receiver - bias)
    return float(np.mean(taps))


def deepest(radius: int) -> float:
    """Return how much deeper than the depth of a tap the surface can be, along this axis, in texels."""
    return (radius + 0.5) * math.tan(TILT)


def slope_bias(radius: int) -> float:
    """Return the bias of `shadow_bias=slope`, in texels; the map's other axis makes the factor sqrt 2."""
    return plane_bias() + math.sqrt(2.0) * deepest(radius)


def plane_bias() -> float:
    """Return the bias of `shadow_bias=plane`, in texels."""
    return CONSTANT + SLOPE * math.tan(TILT)


def bias_of_a_slope() -> Canvas:
    """Acne on a tilted surface; the offset that hides it; and a comparison with the plane at each tap."""
    c = Canvas(
        760,
        330,
        "A tilted surface and the steps that a shadow map holds of it; the same surface with the plane of the receiver",
    )
    _steps(c, (14.0, 64.0))
    _offset(c, (266.0, 64.0))
    _plane(c, (518.0, 64.0))
    return c


UNIT = 34.0


def _ground(c: Canvas, at: Point, title: str) -> None:
    """Draw the texels from the side and the surface; light comes from above."""
    x, y = at
    c.text(x, 22, title, 13, bold=True)
    for texel in range(TEXELS + 1):
        c.line([(x + UNIT * texel, y - 26), (x + UNIT * texel, y + 190)], "card", 1.5)
    for texel in range(TEXELS):
        c.arrow(x + UNIT * (texel + 0.5), y - 28, x + UNIT * (texel + 0.5), y - 10, "s2")
    c.line([_at(at, 0.0), _at(at, float(TEXELS))], "ink", 2)


SQUEEZE = 0.55
"""Depth is drawn shorter, so that six texels of 50 degrees fit."""


def _at(at: Point, x: float, below: float = 0.0) -> Point:
    return at[0] + UNIT * x, at[1] + SQUEEZE * UNIT * (float(depth(x)) + below)


def _steps(c: Canvas, at: Point) -> None:
    _ground(c, at, "no bias")
    for texel in range(TEXELS):
        left, right = _at(at, texel + 0.5), _at(at, texel + 1.0)
        c.polygon([left, (right[0], left[1]), right], "d", "mark")
        c.line([(at[0] + UNIT * texel, left[1]), (at[0] + UNIT * (texel + 1), left[1])], "s1", 3)
        c.line([left, right], "mark", 4)
        c.circle(*left, 3, "paper", "s1")
    c.note(at[0], 278, "blue: what each texel holds")
    c.note(at[0], 296, f"red: deeper than that: {shaded(0.0):.0%} of")
    c.note(at[0], 314, "the surface shades itself")


def _offset(c: Canvas, at: Point) -> None:
    radius = 1
    size = slope_bias(radius)
    _ground(c, at, "an offset for 3 taps")
    x = 4.3
    here = _at(at, x)
    for offset in (-1, 0, 1):
        middle = math.floor(x) + offset + 0.5
        place = _at(at, middle)
        c.line([(place[0] - UNIT / 2, place[1]), (place[0] + UNIT / 2, place[1])], "s1", 3)
        c.circle(*place, 3, "paper", "s1")
    lifted = here[1] - SQUEEZE * UNIT * size
    c.line([(here[0] - 2 * UNIT, lifted), (here[0] + 1.6 * UNIT, lifted)], "mark", 2, dashed=True)
    c.arrow(here[0], here[1], here[0], lifted + 2, "mark")
    c.circle(*here, 4, "ink", "ink")
    c.text(here[0] - 44, lifted + 18, f"{size:.1f} t", 12, role="mark", bold=True)
    c.note(at[0], 278, "the point's own depth less an offset")
    c.note(at[0], 296, "is above all taps; casters closer")
    c.note(at[0], 314, "than the offset cast nothing")


def _plane(c: Canvas, at: Point) -> None:
    size = plane_bias()
    _ground(c, at, "the plane at each tap")
    x = 4.3
    for offset in (-1, 0, 1):
        middle = math.floor(x) + offset + 0.5
        place = _at(at, middle)
        above = _at(at, middle, -size)
        c.line([(place[0] - UNIT / 2, place[1]), (place[0] + UNIT / 2, place[1])], "s1", 3)
        c.line([place, above], "mark", 1.5)
        c.line([(above[0] - 7, above[1]), (above[0] + 7, above[1])], "mark", 3)
        c.circle(*place, 3, "paper", "s1")
    c.circle(*_at(at, x), 4, "ink", "ink")
    c.text(at[0] + UNIT * 2.4, _at(at, 2.9, -size)[1], f"{size:.1f} t", 12, role="mark", bold=True)
    c.note(at[0], 278, f"across the surface {size * math.cos(TILT):.2f} t remain,")
    c.note(at[0], 296, f"with the offset it is {slope_bias(1) * math.cos(TILT):.2f} t; t is")
    c.note(at[0], 314, "the footprint of a texel")
