"""The table of pages: tiles of a face, their words, and where they lie, by the chapter's own pool."""

from __future__ import annotations

from functools import cache

import numpy as np

from chapters.ch08.page_table.lamps import COARSE, COARSE_STEP
from chapters.ch08.page_table.pool import TilePool
from chapters.ch08.shadows.layout import NONE, pages_size
from chapters.ch08.shadows.model import CUBE_FACES, TILE
from tools.site.figures.canvas import Canvas, Point

TILES, STRIDE = 42, 16
"""Tiles of the pool, and words of the table for each face."""
ARRIVE = (4, 4, 1, 16, 4, 1, 4)
"""Tiles of faces that arrive one after another; the second, the third and the fifth go before face CHOSEN comes."""
GO = (1, 2, 4)
CHOSEN, SIZE = 7, 512
NEEDED = (1, 2, 3, 5, 6, 9, 10, 14)
"""Tiles of that face that the picture reads."""
COARSE_WORD = STRIDE * (CHOSEN + 1)
"""The word of the coarse page of its light, in which the face is the one with the number COARSE_FACE."""
COARSE_FACE = 4
KERNEL = (128 * 2, 128 * 2)
"""The corner of texels over which a kernel of 5x5 lies."""
COLORS = ("c", "f", "d", "e", "f", "d", "c", "a")


@cache
def pool() -> TilePool:
    """Return the pool after some faces have come and gone, and the chosen one has come."""
    held = TilePool(TILES, pages_size(TILES), COARSE_WORD + 1)
    for face, tiles in enumerate(ARRIVE):
        held.assign(STRIDE * face + np.arange(tiles))
    for face in GO:
        held.release(STRIDE * face + np.arange(STRIDE), now=True)
    held.assign(np.array([COARSE_WORD, *(STRIDE * CHOSEN + tile for tile in NEEDED)]))
    return held


def place_of(word: int) -> Point:
    """Return the column and the row that a word names."""
    return word & 0xFF, word >> 8 & 0xFF


def words_of(face: int) -> dict[int, int]:
    """Return the words of the tiles of a face that have memory."""
    words = pool().table[STRIDE * face : STRIDE * (face + 1)].tolist()
    return {tile: word for tile, word in enumerate(words) if word != NONE}


def coarse_word() -> int:
    """Return the word of the coarse page."""
    return int(pool().table[COARSE_WORD])


def tiles_of_kernel() -> list[int]:
    """Return the tiles of the chosen face that the kernel reads."""
    x, y = KERNEL
    side = SIZE // TILE
    return sorted({(y + dy) // TILE * side + (x + dx) // TILE for dy in (-1, 1) for dx in (-1, 1)})


def table_of_pages() -> Canvas:
    """A face of 4x4 tiles, its words, and the pages of all faces."""
    c = Canvas(
        760,
        400,
        "Tiles of a face, the words of the table, and the tiles of the pages that they name; what has no tile is shown "
        "by the coarse page; a kernel over the corner of four tiles",
    )
    count, read = SIZE // TILE, tiles_of_kernel()
    side, left, top = 50.0, 16.0, 48.0
    c.text(left, 26, f"a face of {SIZE}x{SIZE} texels", 13, bold=True)
    for tile in range(count * count):
        x, y = left + side * (tile % count), top + side * (tile // count)
        fill = "b" if tile in read else "a" if tile in NEEDED else "paper"
        c.box(x, y, side, side, "", fill, dashed=tile not in NEEDED, round=0)
        c.text(x + 6, y + side / 2 + 4, str(tile), 11)
    middle = left + side * KERNEL[0] / TILE, top + side * KERNEL[1] / TILE
    step = 6.0
    for dy in range(-2, 3):
        for dx in range(-2, 3):
            place = middle[0] + step * (dx - 0.5), middle[1] + step * (dy - 0.5), step, step
            c.rectangle(place, "paper", "mark", False, 0)
    _coarse_page(c, (left, top + 4 * side + 14))
    _words(c, (268.0, top), read)
    _pages(c, (452.0, top), read)
    return c


def _coarse_page(c: Canvas, at: Point) -> None:
    """Draw the tile that six coarse faces share."""
    x, y = at
    scale = 84.0 / TILE
    c.rectangle((x, y, 84, 84), "paper", "ink", False, 0)
    for face in range(CUBE_FACES):
        row, column = divmod(face, 3)
        place = x + scale * COARSE_STEP * column, y + scale * COARSE_STEP * row
        c.box(
            *place,
            scale * COARSE,
            scale * COARSE,
            str(face),
            "f" if face == COARSE_FACE else "card",
            11,
            round=0,
        )
    c.note(x + 94, y + 14, "the coarse page of")
    c.note(x + 94, y + 31, f"its light: {CUBE_FACES} faces")
    c.note(x + 94, y + 48, f"of {COARSE}x{COARSE} texels")
    c.note(x, y + 106, "dashed: no memory. The coarse face")
    c.note(x, y + 124, f"{COARSE_FACE} shows these parts")


def _words(c: Canvas, at: Point, read: list[int]) -> None:
    """Draw the words of the chosen face."""
    x, y = at
    c.text(x, 26, "its words of the table", 13, bold=True)
    words = words_of(CHOSEN)
    for tile in range(STRIDE):
        column, row = divmod(tile, 8)
        place = x + 84 * column, y + 25 * row, 78, 21
        if tile in words:
            named = "{}, {}".format(*place_of(words[tile]))
            c.box(*place, f"{tile}: {named}", "b" if tile in read else "paper", 12, round=2)
        else:
            c.box(*place, f"{tile}: none", "paper", 12, dashed=True, round=2)
    named = "{}, {}".format(*place_of(coarse_word()))
    c.box(x, y + 208, 162, 21, f"coarse page: {named}", "f", 12, round=2)
    c.note(x, y + 252, "column and row of a")
    c.note(x, y + 270, "tile, 8 bits each; the")
    c.note(x, y + 288, "layer is above them")


def _pages(c: Canvas, at: Point, read: list[int]) -> None:
    """Draw the tiles of all faces."""
    x, y = at
    side = 34.0
    columns, rows = pages_size(TILES)
    c.text(x, 26, f"the pages: {columns}x{rows} tiles", 13, bold=True)
    c.rectangle((x, y, side * columns, side * rows), "paper", "line", True, 0)
    faces = [face for face in range(CHOSEN + 1) if words_of(face)]
    for face in faces:
        for tile, word in words_of(face).items():
            column, row = place_of(word)
            chosen = face == CHOSEN
            fill = "b" if chosen and tile in read else COLORS[face]
            place = x + side * column, y + side * row, side, side
            c.box(*place, str(tile), fill, 11, round=0, stroke="ink" if chosen else "line")
    column, row = place_of(coarse_word())
    c.box(x + side * column, y + side * row, side, side, "c.", "f", 11, round=0, stroke="ink")
    bottom = y + side * rows
    c.note(x, bottom + 20, f"{len(faces)} faces, with the numbers of their tiles. The")
    c.note(x, bottom + 38, "marked one lies where others have gone:")
    c.note(x, bottom + 56, "neighbours in the face are none here.")
    c.note(x, bottom + 80, "red: a kernel of 5x5 texels, enlarged")
