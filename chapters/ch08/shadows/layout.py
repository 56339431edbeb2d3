"""The buffer of a frame's shadows, and the places of tiles in the pages; needs no device.

    shadow_of      a word a light record: 0, or 1 + its first face, and its number of faces from bit 24 on
    shadow_drawn   a word a face that the frame draws: bits 0 to 11 its number, 12 to 15 its place among the faces of
                   its light, from 16 on the number of its list
    shadow_lists   a word a list of casters (lists.py): the first face of its light, and the number of its faces from
                   bit 24 on
    shadow_faces   FACE records
    shadow_table   a word a tile of each face: its place in the pages, in tiles

A face of `size` texels has (size / TILE)^2 tiles, row by row. The table lets each tile lie anywhere in the pages.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .faces import FACE
from .model import padded

TILE = 128
TILE_BYTES = TILE * TILE * 4
"""A tile is a page of sparse memory: 64 KiB of R32F."""

WIDEST = 128
"""Tiles in a row of the pages: 16,384 texels, which is the side of the largest image of every device that is used."""


@dataclass(frozen=True)
class BlockLayout:
    """The byte offsets of the parts, for `lights` records, `faces` faces and `tiles` words of the table."""

    lights: int
    faces: int
    tiles: int

    @property
    def drawn(self) -> int:
        """The first byte of `shadow_drawn`."""
        return 4 * padded(self.lights)

    @property
    def lists(self) -> int:
        """The first byte of `shadow_lists`."""
        return self.drawn + 4 * padded(self.faces)

    @property
    def records(self) -> int:
        """The first byte of the records."""
        return self.lists + 4 * padded(self.faces)

    @property
    def table(self) -> int:
        """The first byte of the table."""
        return self.records + FACE.itemsize * padded(self.faces)

    @property
    def size(self) -> int:
        """Bytes of the whole buffer."""
        return self.table + 4 * max(1, self.tiles)


def tiles_of(sizes: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the tiles of faces of these sizes in texels."""
    side = -(-sizes // TILE)
    tiles: NDArray[np.int64] = side * side
    return tiles


def place_tiles(faces: np.ndarray) -> None:
    """Give each face its own words of the table."""
    tiles = tiles_of(faces["size"].astype(np.int64))
    faces["first"] = np.cumsum(tiles) - tiles
    faces["tiles"] = -(-faces["size"].astype(np.int64) // TILE)


def full_table(tiles: int, width: int) -> NDArray[np.uint32]:
    """Return the table of pages that hold everything: tile after tile, `width` in a row."""
    number = np.arange(tiles)
    return ((number % width) | (number // width) << 16).astype(np.uint32)


def pages_size(tiles: int) -> tuple[int, int]:
    """Return columns and rows of the smallest image with room for some tiles, about as high as it is wide."""
    width = min(WIDEST, max(1, int(np.ceil(np.sqrt(tiles)))))
    return width, max(1, -(-tiles // width))


def fitting_sizes(counts: NDArray[np.int64], sizes: NDArray[np.int64], most: int) -> NDArray[np.int64]:
    """Return (N,) sizes of the faces of lights, so that all of them together have at most `most` tiles.

    `counts` (N,) are faces of each light, the most important light first, and `sizes` (N,) what they ask for. The least
    important lights lose half of their size first, down to one tile a face; lights for which even that is too much get
    size 0. A light of another size than the one before it costs one level, so sizes never grow towards less important
    lights of the same wish.
    """
    sizes = sizes.copy()
    while True:
        excess = int((counts * tiles_of(sizes)).sum()) - most
        if excess <= 0:
            return sizes
        largest = sizes > TILE
        if not largest.any():
            kept = np.cumsum(counts * tiles_of(sizes)) <= most
            return np.where(kept, sizes, 0)
        finest = sizes == sizes.max()
        gain = np.where(finest, counts * (tiles_of(sizes) - tiles_of(sizes // 2)), 0)
        # From the last light on, as many as it takes.
        saved = np.cumsum(gain[::-1])[::-1]
        halved = finest & (saved - gain < excess)
        sizes[halved] //= 2
