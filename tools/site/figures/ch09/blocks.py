"""Where blocks are lit, also at the edge of a picture; and the two passes that light fragments without an extension."""

from __future__ import annotations

from tools.site.figures.canvas import Canvas, Point

SIZE = (11, 9)
"""Pixels of a picture that is no multiple of a block."""
PIXEL = 24.0


def lit_pixel(origin: tuple[int, int], side: int, size: tuple[int, int] = SIZE) -> tuple[int, int]:
    """Return the pixel that is lit for a block, as rates/codes.glsl has it."""
    x, y = (min(first + side // 2, most - 1) for first, most in zip(origin, size, strict=True))
    return x, y


def lit(side: int) -> dict[tuple[int, int], tuple[int, int]]:
    """Return the lit pixel of each block by the block's first pixel."""
    width, height = SIZE
    origins = [(x, y) for y in range(0, height, side) for x in range(0, width, side)]
    return {origin: lit_pixel(origin, side) for origin in origins}


def blocks_and_passes() -> Canvas:
    """The corner of a picture in blocks of 4x4, and the passes."""
    c = Canvas(
        760,
        352,
        "A picture in blocks with the pixel that is lit in each; at its edge the pixel moves inside; two passes with "
        "their depths",
    )
    _corner(c, (20.0, 44.0), 4)
    _passes(c, (384.0, 44.0))
    return c


def _corner(c: Canvas, at: Point, side: int) -> None:
    """Draw the pixels of a picture, its blocks, and what is lit."""
    x, y = at
    c.text(x, 26, f"{SIZE[0]}x{SIZE[1]} pixels in blocks of {side}x{side}", 13, bold=True)
    pixels = set(lit(side).values())
    for row in range(SIZE[1]):
        for column in range(SIZE[0]):
            fill = "s2" if (column, row) in pixels else "paper"
            c.rectangle((x + PIXEL * column, y + PIXEL * row, PIXEL, PIXEL), fill, "line", False, 0)
    for left, top in lit(side):
        px, py = x + PIXEL * left, y + PIXEL * top
        edge = PIXEL * side
        corners = [(px, py), (px + edge, py), (px + edge, py + edge), (px, py + edge), (px, py)]
        c.line(corners, "ink", 2.5)
        if left + side // 2 >= SIZE[0] or top + side // 2 >= SIZE[1]:
            middle = px + edge / 2, py + edge / 2
            c.circle(*middle, 5, "mark", "mark")
    c.note(x, y + 12.7 * PIXEL, "red: a centre outside of the picture")


def _passes(c: Canvas, at: Point) -> None:
    """Draw what the two passes read and write."""
    x, y = at
    c.text(x, 26, "fragments without an extension", 13, bold=True)
    c.box(x, y, 100, 34, "mask", "d")
    c.box(x + 150, y, 200, 34, "rate_depth: for blocks", "a")
    c.arrow(x + 100, y + 17, x + 148, y + 17)
    c.box(x + 150, y + 66, 200, 50, "lighting_blocks\na fragment for each block", "b")
    c.arrow(x + 250, y + 34, x + 250, y + 64)
    c.note(x + 262, y + 55, "0 or 1")
    c.box(x + 150, y + 148, 200, 50, "rate_spread: light to\npixels, and their depth", "a")
    c.arrow(x + 250, y + 116, x + 250, y + 146)
    c.line([(x + 50, y + 34), (x + 50, y + 173), (x + 148, y + 173)], arrow=True)
    c.box(x + 150, y + 230, 200, 50, "lighting_pixels\na fragment for each pixel", "b")
    c.arrow(x + 250, y + 198, x + 250, y + 228)
    c.note(x + 262, y + 219, "0 or 1")
    c.note(x + 60, y + 302, "0: the early test passes; 1: no invocation")
