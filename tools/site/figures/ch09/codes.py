"""The codes of shading rates, and the pixel of each block that is lit."""

from __future__ import annotations

from chapters.ch09.rates.model import encode
from tools.site.figures.canvas import Canvas

SIDES = (1, 2, 4)
PIXEL = 15.0


def lit(width: int, height: int) -> tuple[int, int]:
    """Return the pixel of a block that is lit, from its first one."""
    return width // 2, height // 2


def codes_of_rates() -> Canvas:
    """A table of blocks: columns have a width, rows a height."""
    c = Canvas(760, 290, "The nine rates with their codes, and in each block the pixel that is lit")
    left, top, wide = 130.0, 60.0, 210.0
    for column, width in enumerate(SIDES):
        c.text(left + wide * column, 28, f"width {width}: bits {width.bit_length() - 1:02b}", 13, bold=True)
    y = top
    for height in SIDES:
        c.text(16, y + 14, f"height {height}:", 13, bold=True)
        c.text(16, y + 32, f"bits {height.bit_length() - 1:02b}", 13, bold=True)
        for column, width in enumerate(SIDES):
            x, code = left + wide * column, encode(width, height)
            for row in range(height):
                for place in range(width):
                    fill = "s2" if (place, row) == lit(width, height) else "a"
                    c.rectangle((x + PIXEL * place, y + PIXEL * row, PIXEL, PIXEL), fill, "ink", False, 0)
            beside = x + PIXEL * width + 12
            c.text(beside, y + 13, f"code {code}", 13)
            c.note(beside, y + 31, f"{code >> 2:02b} {code & 3:02b}")
        y += max(PIXEL * height, 34.0) + 22
    c.rectangle((16, 258, PIXEL, PIXEL), "s2", "ink", False, 0)
    c.note(40, 270, "the pixel that is lit: its place in the block is half of each side, rounded down")
    return c
