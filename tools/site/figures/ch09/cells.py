"""The cells of the study shading-rates: where a rate comes from, and which blocks of a cell run for two triangles."""

from __future__ import annotations

from tools.site.figures.canvas import Canvas, Point

COLUMNS, ROWS = 8, 6
"""Cells of the study's picture; its two draws have half of the rows each."""
BLOCKS = 8
"""Blocks of 2x2 along a cell of 16 pixels."""


def triangles_of(column: int, row: int, blocks: int = BLOCKS) -> int:
    """Return how many of a cell's two triangles have pixels in a block; the diagonal goes up to the right."""
    below = column + row >= blocks - 1
    above = column + row <= blocks - 1
    return int(below) + int(above)


def fragments(blocks: int = BLOCKS) -> int:
    """Return how many fragments a cell runs: one for each block and triangle with pixels in it."""
    return sum(triangles_of(column, row, blocks) for row in range(blocks) for column in range(blocks))


def cells_of_the_study() -> Canvas:
    """The picture with rates by draw and by primitive, and one cell in blocks."""
    c = Canvas(
        760,
        286,
        "Cells of two draws: the lower draw has a rate, or every second cell has; and a cell whose blocks on the "
        "diagonal run twice",
    )
    _picture(c, (16.0, 48.0), "source=pipeline, dynamic", False)
    _picture(c, (262.0, 48.0), "source=vertex, mesh", True)
    x, y, side = 508.0, 48.0, 21.0
    c.text(x, 26, "a cell in blocks of 2x2", 13, bold=True)
    for row in range(BLOCKS):
        for column in range(BLOCKS):
            fill = "b" if triangles_of(column, row) == 2 else "a"
            c.rectangle((x + side * column, y + side * row, side, side), fill, "line", False, 0)
    edge = side * BLOCKS
    c.line([(x, y + edge), (x + edge, y)], "mark", 2)
    c.note(x, y + edge + 24, f"{BLOCKS * BLOCKS} blocks. {BLOCKS} of them lie in both")
    c.note(x, y + edge + 41, f"triangles: {fragments()} fragments")
    c.note(16, y + edge + 24, "blue: 2x2. The red line is between the draws.")
    return c


def _picture(c: Canvas, at: Point, title: str, by_primitive: bool) -> None:
    """Draw the cells of the study with their rates."""
    x, y = at
    side = 27.0
    c.text(x, 26, title, 13, bold=True)
    for row in range(ROWS):
        for column in range(COLUMNS):
            coarse = (column + row) % 2 == 1 if by_primitive else row >= ROWS // 2
            place = x + side * column, y + side * row, side, side
            c.rectangle(place, "s1" if coarse else "paper", "line", False, 0)
    middle = y + side * ROWS / 2
    c.line([(x, middle), (x + side * COLUMNS, middle)], "mark", 2)
