"""The tiles in which a large picture is traced.

They bound the memory of a device, whatever the size of the picture, and let many workers share it. A pixel has the
same random numbers in a tile as in the whole picture. Tiles follow from the size of the picture alone, so one process
and many workers add up the same sums.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

Float32 = NDArray[np.float32]

LARGEST = 512
"""Pixels along an edge of a tile at most. A picture that has no more pixels than such a tile is one."""


@dataclass(frozen=True)
class Tile:
    """A rectangle of a picture: the place of its upper left pixel, and its size, both as (x, y) in pixels."""

    number: int
    first: tuple[int, int]
    size: tuple[int, int]

    @property
    def place(self) -> tuple[slice, slice]:
        """Rows and columns of its pixels in arrays of the picture."""
        (x, y), (width, height) = self.first, self.size
        return slice(y, y + height), slice(x, x + width)


def tiles_of(size: tuple[int, int]) -> tuple[Tile, ...]:
    """Return the tiles that cover a picture of (width, height) pixels, row by row.

    All are of one size, so that one renderer traces them. Where sides leave a rest, the last tiles of rows and columns
    begin earlier, and some of their pixels are in the tile before as well, with the same paths.
    """
    return _cut(size, LARGEST)


@lru_cache(64)
def _cut(size: tuple[int, int], largest: int) -> tuple[Tile, ...]:
    whole = size[0] * size[1] <= largest * largest
    counts = tuple(1 if whole else -(-side // largest) for side in size)
    columns, rows = counts
    width, height = (-(-side // count) for side, count in zip(size, counts, strict=True))
    places = [
        (min(column * width, size[0] - width), min(row * height, size[1] - height))
        for row in range(rows)
        for column in range(columns)
    ]
    return tuple(Tile(number, place, (width, height)) for number, place in enumerate(places))


def nothing_done(tile: Tile) -> None:
    """Ignore that a tile is done."""


def merged(
    tiles: tuple[Tile, ...],
    size: tuple[int, int],
    blocks: Iterable[tuple[Float32, Float32]],
    done: Callable[[Tile], object] = nothing_done,
) -> tuple[Float32, Float32]:
    """Return the sums of light (H, W, 4) and of squares (H, W, 2) of a picture from those of its tiles, in their order.

    Of a pixel that two tiles have, the sums of the later one count. `done` is called behind each tile.
    """
    width, height = size
    light, squares = np.empty((height, width, 4), np.float32), np.empty((height, width, 2), np.float32)
    for tile, (one, other) in zip(tiles, blocks, strict=True):
        light[tile.place], squares[tile.place] = one, other
        done(tile)
    return light, squares
