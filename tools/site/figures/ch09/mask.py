"""From pixels to a texel of the mask: codes of luminance, squared gradients, and one rate."""

from __future__ import annotations

from functools import cache

import numpy as np
from numpy.typing import NDArray

from chapters.ch09.rates.model import TEXEL, encode
from tools.site.figures.canvas import Canvas, Point

Float64 = NDArray[np.float64]

SIZE = (4 * TEXEL, 3 * TEXEL)
"""Pixels of the picture."""
DARK, BRIGHT = 0.3, 0.8
FAINT = 0.35
"""A band that is so little brighter than the dark part that it is no edge."""
THRESHOLD = 0.1
CHOSEN = (1, 1)
"""The texel of the drawing."""
COARSE = encode(2, 2)


@cache
def picture() -> Float64:
    """Return (H, W) codes of luminance: a bright slope over a dark ground, and a faint band."""
    y, x = np.indices((SIZE[1], SIZE[0]), dtype=np.float64)
    codes = np.where(y > 38, FAINT, DARK)
    return np.where((y > 1.1 * x - 4) & (x > 10) & (y < 30), BRIGHT, codes)


@cache
def squared() -> Float64:
    """Return (H, W) the squared gradient of each pixel, by Sobel and by steps to the next pixels."""
    t = np.pad(picture(), 1, mode="edge")

    def at(dx: int, dy: int) -> Float64:
        part: Float64 = t[1 + dy : 1 + dy + SIZE[1], 1 + dx : 1 + dx + SIZE[0]]
        return part

    across = at(-1, -1) - at(1, -1) + 2 * (at(-1, 0) - at(1, 0)) + at(-1, 1) - at(1, 1)
    down = at(-1, -1) - at(-1, 1) + 2 * (at(0, -1) - at(0, 1)) + at(1, -1) - at(1, 1)
    steps = 16 * np.maximum((at(1, 0) - at(0, 0)) ** 2, (at(0, 1) - at(0, 0)) ** 2)
    found: Float64 = np.maximum(across**2 + down**2, steps)
    return found


def codes() -> NDArray[np.int64]:
    """Return (rows, columns) the code of each texel: fine if one of its pixels is an edge."""
    rows, columns = SIZE[1] // TEXEL, SIZE[0] // TEXEL
    edges = (squared() > THRESHOLD).reshape(rows, TEXEL, columns, TEXEL).any(axis=(1, 3))
    return np.where(edges, 0, COARSE)


def texel_of_the_mask() -> Canvas:
    """The pixels that a work group reads, its gradients, and the mask of the picture."""
    c = Canvas(
        760,
        336,
        "A texel of the mask: 16x16 pixels and the border of one pixel, the gradient of each pixel, and one code for "
        "all",
    )
    pixel, top = 12.0, 48.0
    first = CHOSEN[0] * TEXEL, CHOSEN[1] * TEXEL
    c.text(16, 26, "18x18 codes in shared memory", 13, bold=True)
    for row in range(-1, TEXEL + 1):
        for column in range(-1, TEXEL + 1):
            value = picture()[first[1] + row, first[0] + column]
            own = 0 <= row < TEXEL and 0 <= column < TEXEL
            place = 16 + pixel * (column + 1), top + pixel * (row + 1), pixel, pixel
            c.rectangle(place, "b" if value == BRIGHT else "a", "ink" if own else "paper", False, 0)
    c.note(16, 286, "without outlines: the border,")
    c.note(16, 303, "which belongs to other texels")
    left = 270.0
    c.text(left, 26, "16x16 squared gradients", 13, bold=True)
    for row in range(TEXEL):
        for column in range(TEXEL):
            edge = squared()[first[1] + row, first[0] + column] > THRESHOLD
            place = left + pixel * column, top + pixel * (row + 1), pixel, pixel
            c.rectangle(place, "mark" if edge else "paper", "line", False, 0)
    c.note(left, 286, f"red: above {THRESHOLD:g}. One is")
    c.note(left, 303, "enough for code 0")
    _mask(c, (504.0, top + pixel))
    c.arrow(238, top + 9 * pixel, left - 8, top + 9 * pixel)
    c.arrow(left + 16 * pixel + 6, top + 9 * pixel, 496, top + 9 * pixel)
    return c


def _mask(c: Canvas, at: Point) -> None:
    """Draw the codes of all texels."""
    x, y = at
    side = 52.0
    c.text(x, 26, "a code for each texel", 13, bold=True)
    for row, values in enumerate(codes().tolist()):
        for column, code in enumerate(values):
            chosen = (column, row) == CHOSEN
            place = x + side * column, y + side * row, side, side
            c.box(
                *place, str(code), "d" if code else "paper", 14, round=0, stroke="mark" if chosen else "line"
            )
    c.note(x, y + 3 * side + 22, "0: each pixel, 5: blocks of 2x2")
    c.note(x, y + 3 * side + 42, "The lowest row has a faint band,")
    c.note(x, y + 3 * side + 59, "with gradients below 0.1")
