"""What a work group lights: an area in blocks, the list of what is lit, and rounds of invocations over the list."""

from __future__ import annotations

from tools.site.figures.canvas import Canvas, Point

AREA, INVOCATIONS, BLOCK = 8, 8, 2
"""Pixels along the area of the drawing, invocations of its work group, pixels along a coarse block."""

FINE = frozenset({(1, 0), (1, 1), (2, 1), (2, 2)})
"""The blocks (column, row) in which each pixel is lit."""

PIXEL = 26.0

Entry = tuple[int, int, int]
"""x and y within the area, and pixels along what is lit at once."""


def blocks() -> list[tuple[int, int]]:
    """Return all blocks, row by row."""
    count = AREA // BLOCK
    return [(column, row) for row in range(count) for column in range(count)]


def listed() -> list[Entry]:
    """Return the list, if blocks come in their order: an entry for a coarse block, one for each pixel of a fine one."""
    found: list[Entry] = []
    for column, row in blocks():
        x, y = BLOCK * column, BLOCK * row
        if (column, row) in FINE:
            found += [(x + i, y + j, 1) for j in range(BLOCK) for i in range(BLOCK)]
        else:
            found.append((x, y, BLOCK))
    return found


def rounds() -> int:
    """Return how often the invocations take an entry each, until the list is done."""
    return -(-len(listed()) // INVOCATIONS)


def list_of_an_area() -> Canvas:
    """An area of the picture, and the list in rounds."""
    c = Canvas(
        760,
        312,
        "An area in blocks, the list of what is lit in it, and the rounds in which invocations light the list",
    )
    c.text(16, 26, f"an area of {AREA}x{AREA} pixels", 13, bold=True)
    numbers = {(x, y): number for number, (x, y, _) in enumerate(listed())}
    for (x, y), number in numbers.items():
        side = listed()[number][2]
        place = 16 + PIXEL * x, 44 + PIXEL * y, PIXEL * side, PIXEL * side
        c.box(*place, str(number), "d" if side > 1 else "b", 12, round=0)
    c.rectangle((16, 266, 14, 14), "d", "line", False, 0)
    c.note(36, 278, "a coarse block: one entry")
    c.rectangle((16, 286, 14, 14), "b", "line", False, 0)
    c.note(36, 298, f"a fine block: {BLOCK * BLOCK} entries, one for each pixel")
    c.arrow(16 + PIXEL * AREA + 8, 150, 310, 150)
    _rounds(c, (330.0, 44.0))
    return c


def _rounds(c: Canvas, at: Point) -> None:
    """Draw the list: a row for each round, a column for each invocation."""
    x, y = at
    wide, high = 46.0, 40.0
    c.text(x, 26, f"the list, by {INVOCATIONS} invocations", 13, bold=True)
    entries = listed()
    for number in range(rounds() * INVOCATIONS):
        place = x + wide * (number % INVOCATIONS), y + 22 + (high + 12) * (number // INVOCATIONS), wide, high
        if number < len(entries):
            c.box(*place, str(number), "d" if entries[number][2] > 1 else "b", 13, round=0)
        else:
            c.box(*place, "", "paper", dashed=True, round=0)
    for number in range(INVOCATIONS):
        c.note(x + wide * (number + 0.5) - 4, y + 14, str(number))
    idle = rounds() * INVOCATIONS - len(entries)
    under = y + 22 + (high + 12) * rounds() + 14
    c.note(
        x, under, f"{len(entries)} entries in {rounds()} rounds; dashed: {idle} invocations without an entry"
    )
