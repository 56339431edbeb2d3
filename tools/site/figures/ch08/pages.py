"""The table of pages: tiles of a face, their words, and where they lie, by the chapter's own pool."""

from __future__ import annotations

from functools import cache

import numpy as np

from chapters.ch08.page_table.pool import NONE, TilePool
from chapters.ch08.shadows.layout import pages_size
from chapters.ch08.shadows.model import TILE
from tools.site.figures.canvas import Canvas, Point

TILES, STRIDE = 42, 16
"""Tiles of the pool, and words of the table for each face."""
ARRIVE = (4, 4, 1, 16, 4, 1, 4)
"""Tiles of faces that arrive one after another; the second, the third and the fifth go before face CHOSEN comes."""
GO = (1, 2, 4)
CHOSEN, SIZE = 7, 512
KERNEL = (128 * 2, 128 * 2)
"""The corner of texels over which a kernel of 5x5 lies."""
COLORS = ("c", "f", "d", "e", "f", "d", "c", "a")


@cache
def pool() -> TilePool:
    """Return the pool after some faces have come and gone, and the chosen one has come."""
    held = TilePool(TILES, pages_size(TILES)[0], STRIDE * (CHOSEN + 1))
    for face, tiles in enumerate(ARRIVE):
        held.assign(STRIDE * face + np.arange(tiles))
    for face in GO:
        held.release(STRIDE * face + np.arange(STRIDE))
    held.assign(STRIDE * CHOSEN + np.arange((SIZE // TILE) ** 2))
    return held


def words_of(face: int) -> list[int]:
    """Return the words of the tiles that a face has."""
    words = pool().table[STRIDE * face : STRIDE * (face + 1)]
    return [int(word) for word in words if word != NONE]


def tiles_of_kernel() -> list[int]:
    """Return the tiles of the chosen face that the kernel reads."""
    x, y = KERNEL
    side = SIZE // TILE
    return sorted({(y + dy) // TILE * side + (x + dx) // TILE for dy in (-1, 1) for dx in (-1, 1)})


def table_of_pages() -> Canvas:
    """A face of 4x4 tiles, its words, and the pages of all faces."""
    c = Canvas(
        760,
        342,
        "Tiles of a face, the words of the table, and the tiles of the pages that they name; a kernel over the edge "
        "of a tile",
    )
    count, read = SIZE // TILE, tiles_of_kernel()
    side, left, top = 50.0, 16.0, 48.0
    c.text(left, 26, f"a face of {SIZE}x{SIZE} texels", 13, bold=True)
    for tile in range(count * count):
        x, y = left + side * (tile % count), top + side * (tile // count)
        c.box(x, y, side, side, "", "b" if tile in read else "a", round=0)
        c.text(x + 6, y + side / 2 + 4, str(tile), 11)
    middle = left + side * KERNEL[0] / TILE, top + side * KERNEL[1] / TILE
    step = 6.0
    for dy in range(-2, 3):
        for dx in range(-2, 3):
            place = middle[0] + step * (dx - 0.5), middle[1] + step * (dy - 0.5), step, step
            c.rectangle(place, "paper", "mark", False, 0)
    c.note(left, top + 4 * side + 22, "red: a kernel of 5x5 texels, larger")
    c.note(left, top + 4 * side + 40, "than they are, over four tiles")
    c.note(left, top + 4 * side + 66, f"tiles in a row: {count}")
    _words(c, (268.0, top), read)
    _pages(c, (452.0, top), read)
    return c


def _words(c: Canvas, at: Point, read: list[int]) -> None:
    """Draw the words of the chosen face."""
    x, y = at
    c.text(x, 26, "its words of the table", 13, bold=True)
    for tile, word in enumerate(words_of(CHOSEN)):
        column, row = divmod(tile, 8)
        fill = "b" if tile in read else "paper"
        place = x + 84 * column, y + 25 * row, 78, 21
        c.box(*place, f"{tile}: {word & 0xFFFF}, {word >> 16}", fill, 12, round=2)
    c.note(x, y + 222, "x and y of a tile in the")
    c.note(x, y + 240, "pages, 16 bits each")


def _pages(c: Canvas, at: Point, read: list[int]) -> None:
    """Draw the tiles of all faces."""
    x, y = at
    side = 34.0
    columns, rows = pages_size(TILES)
    c.text(x, 26, f"the pages: {columns}x{rows} tiles", 13, bold=True)
    c.rectangle((x, y, side * columns, side * rows), "paper", "line", True, 0)
    faces = [face for face in range(CHOSEN + 1) if words_of(face)]
    for face in faces:
        for tile, word in enumerate(words_of(face)):
            place = x + side * (word & 0xFFFF), y + side * (word >> 16), side, side
            chosen = face == CHOSEN
            fill = "b" if chosen and tile in read else COLORS[face]
            c.box(*place, str(tile), fill, 11, round=0, stroke="ink" if chosen else "line")
    bottom = y + side * rows
    c.note(x, bottom + 20, f"{len(faces)} faces, with the numbers of their tiles. The")
    c.note(x, bottom + 38, "marked one lies where others have gone:")
    c.note(x, bottom + 56, "neighbours in the face are none here.")
