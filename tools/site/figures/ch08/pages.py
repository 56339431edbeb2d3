"""The table of pages: tiles of a face, their words, and where they lie, by the chapter's own layout."""

from __future__ import annotations

import numpy as np

from chapters.ch08.shadows.faces import FACE
from chapters.ch08.shadows.layout import TILE, full_table, pages_size, place_tiles, tiles_of
from tools.site.figures.canvas import Canvas, Point

SIZES = (256, 256, 512, 256, 256, 128, 128, 256)
"""Texels of the faces; CHOSEN is shown."""
CHOSEN = 2
KERNEL = (128 * 2 - 3, 128 * 2 - 2)
"""The texel in the middle of a kernel of 5x5, which lies over an edge of tiles along both axes."""
COLORS = ("c", "e", "a", "f", "c", "d", "e", "f")


def placed() -> tuple[np.ndarray, np.ndarray, tuple[int, int]]:
    """Return the faces with their first words, the table, and columns and rows of the pages."""
    faces = np.zeros(len(SIZES), FACE)
    faces["size"] = SIZES
    place_tiles(faces)
    tiles = int(tiles_of(faces["size"].astype(np.int64)).sum())
    size = pages_size(tiles)
    return faces, full_table(tiles, size[0]), size


def tile_of(face: np.ndarray, texel: tuple[int, int]) -> int:
    """Return the number of the tile of a face that has a texel."""
    return texel[1] // TILE * int(face["tiles"]) + texel[0] // TILE


def tiles_of_kernel(radius: int = 2) -> list[int]:
    """Return the tiles of the chosen face that a kernel over the edge of tiles reads."""
    face = placed()[0][CHOSEN]
    x, y = KERNEL
    ends = [(x + dx * (radius + 3), y + dy * (radius + 3)) for dy in (0, 1) for dx in (0, 1)]
    return sorted({tile_of(face, texel) for texel in ends})


def table_of_pages() -> Canvas:
    """A face of 4x4 tiles, its words, and the pages of eight faces."""
    c = Canvas(
        760,
        342,
        "Tiles of a face, the words of the table, and the tiles of the pages that they name; a kernel over the edge "
        "of a tile",
    )
    faces, table, (columns, rows) = placed()
    face = faces[CHOSEN]
    count, first = int(face["tiles"]), int(face["first"])
    read = tiles_of_kernel()
    side, left, top = 50.0, 16.0, 48.0
    c.text(left, 26, f"a face of {SIZES[CHOSEN]}x{SIZES[CHOSEN]} texels", 13, bold=True)
    for tile in range(count * count):
        x, y = left + side * (tile % count), top + side * (tile // count)
        c.box(x, y, side, side, "", "b" if tile in read else "a", round=0)
        c.text(x + 6, y + side / 2 + 4, str(tile), 11)
    middle = left + side * KERNEL[0] / TILE + 1.0, top + side * KERNEL[1] / TILE + 1.0
    step = 6.0
    for dy in range(-2, 3):
        for dx in range(-2, 3):
            c.rectangle(
                (middle[0] + step * dx - step / 2, middle[1] + step * dy - step / 2, step, step), "paper", "mark", False, 0
            )
    c.note(left, top + 4 * side + 22, "red: a kernel of 5x5 texels, larger")
    c.note(left, top + 4 * side + 40, "than they are, over four tiles")
    c.note(left, top + 4 * side + 66, f"first = {first}, tiles = {count}")
    _words(c, (276.0, top), table, first, count * count, read)
    _pages(c, (452.0, top), faces, table, columns, rows, read)
    return c


def _words(c: Canvas, at: Point, table: np.ndarray, first: int, count: int, read: list[int]) -> None:
    """Draw the words of the chosen face."""
    x, y = at
    c.text(x, 26, "its words of the table", 13, bold=True)
    for tile in range(count):
        column, row = divmod(tile, 8)
        place = x + 80 * column, y + 25 * row
        word = int(table[first + tile])
        c.box(*place, 72, 21, f"{tile}: {word & 0xFFFF}, {word >> 16}", "b" if tile in read else "paper", 12, round=2)
    c.note(x, y + 222, "x and y of a tile in the")
    c.note(x, y + 240, "pages, 16 bits each")


def _pages(
    c: Canvas, at: Point, faces: np.ndarray, table: np.ndarray, columns: int, rows: int, read: list[int]
) -> None:
    """Draw the tiles of all faces."""
    x, y = at
    side = 34.0
    c.text(x, 26, f"the pages: {columns}x{rows} tiles", 13, bold=True)
    c.rectangle((x, y, side * columns, side * rows), "paper", "line", True, 0)
    for number, face in enumerate(faces):
        for tile in range(int(face["tiles"]) ** 2):
            word = int(table[int(face["first"]) + tile])
            place = x + side * (word & 0xFFFF), y + side * (word >> 16)
            chosen = number == CHOSEN
            fill = "b" if chosen and tile in read else COLORS[number]
            c.box(*place, side, side, str(tile), fill, 11, round=0, stroke="ink" if chosen else "line")
    bottom = y + side * rows
    c.note(x, bottom + 20, f"{len(faces)} faces; the number of a tile in its face.")
    c.note(x, bottom + 38, "The four tiles under the kernel are")
    c.note(x, bottom + 56, "neighbours in the face, not here.")
