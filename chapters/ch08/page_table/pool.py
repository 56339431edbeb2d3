"""A pool of tiles behind a table of words, each of which names the tile of its part of a face, or none. No device."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

NONE = 0xFFFFFFFF
"""The word of a tile that is not there."""


class TilePool:
    """Hands out tiles of an image that is `width` tiles wide. The lowest free ones come first, so equal calls agree."""

    def __init__(self, tiles: int, width: int, words: int) -> None:
        self._free = np.ones(tiles, bool)
        self._tile_of = np.full(words, -1, np.int64)
        self._width = width
        self.table = np.full(words, NONE, np.uint32)
        """(W,) The place of each word's tile: column, and row from bit 16 on."""
        self.revision = 0
        """Grows with every change of the table."""

    @property
    def tiles(self) -> int:
        """The number of all tiles."""
        return len(self._free)

    @property
    def used(self) -> int:
        """Tiles that have an owner."""
        return int(len(self._free) - self._free.sum())

    def release(self, words: NDArray[np.intp]) -> None:
        """Give up the tiles of some words; words without a tile stay as they are."""
        tiles = self._tile_of[words]
        self._free[tiles[tiles >= 0]] = True
        self._tile_of[words], self.table[words] = -1, NONE
        self.revision += 1

    def assign(self, words: NDArray[np.intp]) -> None:
        """Give a free tile to each of some words without one. Raises ValueError if there are not enough."""
        tiles = np.flatnonzero(self._free)[: len(words)]
        if len(tiles) < len(words):
            raise ValueError(f"{len(words)} tiles are more than the {len(tiles)} that are free")
        self._free[tiles] = False
        self._tile_of[words] = tiles
        self.table[words] = ((tiles % self._width) | (tiles // self._width) << 16).astype(np.uint32)
        self.revision += 1
