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
from .model import TILE, padded

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


def pages_size(tiles: int) -> tuple[int, int]:
    """Return columns and rows of the smallest image with room for some tiles, about as high as it is wide."""
    width = min(WIDEST, max(1, int(np.ceil(np.sqrt(tiles)))))
    return width, max(1, -(-tiles // width))
