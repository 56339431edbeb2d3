"""From pixels to masks: codes of luminance in a tile, squared gradients, and one rate for each texel of two sizes."""

from __future__ import annotations

from functools import cache
from itertools import groupby

import numpy as np
from numpy.typing import NDArray

from chapters.ch09.rates.model import EDGE_TILE, TEXEL, encode
from tools.site.figures.canvas import Canvas, Point

Float64 = NDArray[np.float64]

SIZE = (3 * EDGE_TILE, 3 * EDGE_TILE)
"""Pixels of the picture."""
CHOSEN = (1, 1)
"""The tile of the drawing."""
DARK, BRIGHT = 0.3, 0.8
FAINT = 0.35
"""A band that is so little brighter than the dark part that it is no edge."""
THRESHOLD = 0.1
COARSE = encode(2, 2)
TEXELS = (TEXEL, 2)
"""Pixels along the texels of both masks."""
FILLS = {DARK: "a", FAINT: "e", BRIGHT: "b"}


@cache
def picture() -> Float64:
    """Return (H, W) codes of luminance: a bright slope over a dark ground, and a faint band."""
    y, x = np.indices((SIZE[1], SIZE[0]), dtype=np.float64)
    x, y = x - CHOSEN[0] * EDGE_TILE, y - CHOSEN[1] * EDGE_TILE
    return np.where(y + 0.9 * x < 20, BRIGHT, np.where(y > 24, FAINT, DARK))


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
    return np.maximum(across**2 + down**2, steps)


def of_tile(values: Float64, border: int = 0) -> Float64:
    """Return the part of (H, W) values that is the tile's, with so many pixels around it."""
    x, y = (EDGE_TILE * at for at in CHOSEN)
    part: Float64 = values[y - border : y + EDGE_TILE + border, x - border : x + EDGE_TILE + border]
    return part


def codes(texel: int) -> NDArray[np.int64]:
    """Return (rows, columns) the code of each texel of the tile: fine if one of its pixels is an edge."""
    count = EDGE_TILE // texel
    edges = (of_tile(squared()) > THRESHOLD).reshape(count, texel, count, texel).any(axis=(1, 3))
    return np.where(edges, 0, COARSE)


def tile_of_the_mask() -> Canvas:
    """The pixels that a work group reads, its gradients, and the mask of its tile with texels of two sizes."""
    c = Canvas(
        760,
        330,
        "A tile of a work group: 34x34 codes of luminance, 32x32 gradients, and the mask with texels of 16 and of 2 "
        "pixels",
    )
    pixel, top = 6.0, 48.0
    side = EDGE_TILE * pixel
    c.text(16, 26, "34x34 codes in shared memory", 13, bold=True)
    _cells(c, (16, top), pixel, [[FILLS[value] for value in row] for row in of_tile(picture(), 1).tolist()])
    _frame(c, (16 + pixel, top + pixel), side)
    c.note(16, top + 34 * pixel + 22, "around the frame: the border,")
    c.note(16, top + 34 * pixel + 39, "which belongs to other tiles")
    left = 264.0
    c.text(left, 26, "32x32 squared gradients", 13, bold=True)
    edges = of_tile(squared()) > THRESHOLD
    _cells(c, (left, top + pixel), pixel, [["mark" if edge else "paper" for edge in row] for row in edges])
    _frame(c, (left, top + pixel), side)
    c.note(left, top + 34 * pixel + 22, f"red: above {THRESHOLD:g}. The faint band")
    c.note(left, top + 34 * pixel + 39, "below has gradients of 0.04")
    c.arrow(224, top + 17 * pixel, left - 6, top + 17 * pixel)
    for number, texel in enumerate(TEXELS):
        _mask(c, (504.0 + 130 * number, top + pixel), texel)
    c.arrow(left + side + 6, top + 17 * pixel, 496, top + 17 * pixel)
    c.text(504, 26, "the mask, by pixels of a texel", 13, bold=True)
    c.rectangle((504, 226, 14, 14), "d", "line", False, 0)
    c.note(526, 238, f"{COARSE}: blocks of 2x2")
    c.rectangle((504, 248, 14, 14), "paper", "line", False, 0)
    c.note(526, 260, "0: each pixel is lit")
    return c


def _cells(c: Canvas, at: Point, side: float, fills: list[list[str]]) -> None:
    """Draw rows of squares. Squares of one colour that follow each other are one shape."""
    for row, names in enumerate(fills):
        column = 0
        for fill, run in groupby(names):
            count = len([*run])
            c.rectangle((at[0] + side * column, at[1] + side * row, side * count, side), fill, fill, False, 0)
            column += count
    wide, high = side * len(fills[0]), side * len(fills)
    for number in range(len(fills) + 1):
        c.line([(at[0], at[1] + side * number), (at[0] + wide, at[1] + side * number)], "line", 0.3)
        c.line([(at[0] + side * number, at[1]), (at[0] + side * number, at[1] + high)], "line", 0.3)


def _frame(c: Canvas, at: Point, side: float) -> None:
    """Draw the outline of a square."""
    x, y = at
    c.line([(x, y), (x + side, y), (x + side, y + side), (x, y + side), (x, y)], "ink", 2)


def _mask(c: Canvas, at: Point, texel: int) -> None:
    """Draw the codes of the texels of the tile, and how many are coarse."""
    x, y = at
    side = 112.0
    found = codes(texel)
    fills = [["d" if code else "paper" for code in row] for row in found.tolist()]
    _cells(c, at, side / len(fills), fills)
    _frame(c, at, side)
    c.note(x, y + side + 18, f"{texel}x{texel}: {100 * (found > 0).mean():.0f} % coarse")
