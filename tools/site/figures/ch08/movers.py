"""A tile that movers meet: what is kept without them, what they are, and what is shown, in two frames."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tools.site.figures.canvas import Canvas, Point

Float64 = NDArray[np.float64]

TEXELS = 24
GROUND, CRATE, NOTHING = 3.0, 2.1, 1e30
"""Depths below a lamp in metres: of the ground, of a crate on it, and of a texel that nothing covers."""
CRATE_TEXELS = slice(4, 11)
BALL, RADIUS = 1.9, 3.6
"""The depth of the middle of a ball, and its radius in texels."""
METRES = 0.16
"""Metres for each texel."""
PLACES = (11.0, 17.5)
"""The texel of the ball's middle in two frames."""


def still() -> Float64:
    """Return the (TEXELS,) depths of what stands still."""
    depths = np.full(TEXELS, GROUND)
    depths[CRATE_TEXELS] = CRATE
    return depths


def ball(place: float) -> Float64:
    """Return the (TEXELS,) depths of the ball alone."""
    inside = RADIUS**2 - (np.arange(TEXELS) + 0.5 - place) ** 2
    return np.where(inside > 0, BALL - METRES * np.sqrt(np.maximum(inside, 0.0)), NOTHING)


def shown(place: float) -> Float64:
    """Return the (TEXELS,) depths of a frame: the nearer one of both."""
    nearer: Float64 = np.minimum(still(), ball(place))
    return nearer


def tile_of_movers() -> Canvas:
    """One row of texels: kept, movers and shown, in two frames."""
    c = Canvas(
        760,
        386,
        "A row of texels of a tile in two frames: what is kept without movers, the movers alone, and the nearer depth "
        "of both, which is shown",
    )
    left, right, tops = 24.0, 404.0, (46.0, 166.0, 286.0)
    _profile(c, (left, tops[0]), "kept: what stands still, drawn once", still(), "a")
    for number, (x, place) in enumerate(zip((left, right), PLACES, strict=True)):
        _profile(c, (x, tops[1]), f"frame {number + 1}: movers alone, in a layer", ball(place), "f")
        _profile(c, (x, tops[2]), f"frame {number + 1}, shown: the nearer of both", shown(place), "c")
    x, y = right, tops[0]
    c.text(x, y - 12, "the words of this tile", 13, bold=True)
    c.box(x, y, 150, 24, "shown: 3, 1", "c", 12, round=2)
    c.box(x, y + 32, 150, 24, "kept: 5, 0", "a", 12, round=2)
    c.note(x + 162, y + 16, "what shaders read")
    c.note(x + 162, y + 48, "for the next frames")
    c.note(x, y + 78, "A tile that no mover meets has the first word alone.")
    return c


def _profile(c: Canvas, at: Point, title: str, depths: Float64, fill: str) -> None:
    """Draw depths as heights below a lamp above the drawing."""
    x, y = at
    wide, high, bottom = 14.0, 74.0, 3.3
    c.text(x, y - 12, title, 13, bold=True)
    for texel, depth in enumerate(depths.tolist()):
        if depth < NOTHING:
            top = high * depth / bottom
            c.rectangle((x + wide * texel, y + top, wide, high - top), fill, "line", False, 0)
    c.line([(x, y + high), (x + wide * TEXELS, y + high)], "ink", 1)
