"""A pool of tiles behind a table of words, each of which names the tile of its part of a face, or none. No device."""

from __future__ import annotations

from collections import deque

import numpy as np
from numpy.typing import NDArray

from ..shadows.layout import NONE

FRAMES = 2
"""Frames between giving up a tile and giving it to another word: until then a frame in flight may read it."""


def places_of(numbers: NDArray[np.int64], width: int, height: int) -> NDArray[np.uint32]:
    """Return the words for tiles with these numbers, row by row in layers of `width` x `height` tiles."""
    row, column = np.divmod(numbers, width)
    layer, row = np.divmod(row, height)
    return (column | row << 8 | layer << 16).astype(np.uint32)


class TilePool:
    """Hands out tiles of memory. The lowest free ones come first, so equal calls agree.

    A tile of a face has two words: what is shown, and in the second half of the table what is kept without movers. The
    memory is an image of `size` (columns, rows) in tiles. With `virtual` (W + tiles,) the table holds these places
    instead: one for each word that is shown, and one for each tile that is kept. The tiles are memory behind them.
    """

    def __init__(
        self, tiles: int, size: tuple[int, int], words: int, virtual: NDArray[np.uint32] | None = None
    ) -> None:
        self._free = np.ones(tiles, bool)
        self.is_waiting = np.zeros(tiles, bool)
        """(tiles,) Which tiles were given up that cannot be given away yet."""
        self._waiting: deque[tuple[int, NDArray[np.int64]]] = deque()
        self._places = places_of(np.arange(tiles), *size)
        self._virtual = virtual
        self._frame = 0
        self.shown = words
        """The number W of words that are shown."""
        self.tile_of = np.full(2 * words, -1, np.int64)
        """(2 W,) The tile of each word, -1 for none."""
        self.table = np.full(2 * words, NONE, np.uint32)
        """(2 W,) Where shaders find each word's tile (layout.py)."""
        self.revision = 0
        """Grows with every change of the table, and when tiles become free."""

    @property
    def tiles(self) -> int:
        """The number of all tiles."""
        return len(self._free)

    @property
    def used(self) -> int:
        """Tiles that have an owner."""
        return int((self.tile_of >= 0).sum())

    @property
    def free(self) -> int:
        """Tiles that can be given away now."""
        return int(self._free.sum())

    @property
    def waiting(self) -> bool:
        """Whether tiles were given up that cannot be given away yet."""
        return bool(self._waiting)

    def limit(self, tiles: int) -> None:
        """Do without the tiles from a number on, none of which has an owner: there is no memory for them."""
        self._free, self.is_waiting = self._free[:tiles], self.is_waiting[:tiles]

    def begin(self) -> None:
        """Begin a frame: what was given up FRAMES ago is free."""
        self._frame += 1
        while self._waiting and self._waiting[0][0] + FRAMES <= self._frame:
            self._let_go()

    def _let_go(self) -> None:
        _, tiles = self._waiting.popleft()
        self._free[tiles], self.is_waiting[tiles] = True, False
        self.revision += 1

    def release(self, words: NDArray[np.intp], now: bool = False) -> None:
        """Give up the tiles of some words; words without a tile stay as they are.

        With `now` they are free at once: no frame in flight reads them.
        """
        tiles = self.tile_of[words]
        tiles = tiles[tiles >= 0]
        if now:
            self._free[tiles] = True
            while self._waiting:
                self._let_go()
        elif len(tiles):
            self._waiting.append((self._frame, tiles))
            self.is_waiting[tiles] = True
        self.tile_of[words], self.table[words] = -1, NONE
        self.revision += 1

    def assign(self, words: NDArray[np.intp]) -> None:
        """Give a free tile to each of some words without one. Raises ValueError if there are not enough."""
        tiles = np.flatnonzero(self._free)[: len(words)]
        if len(tiles) < len(words):
            raise ValueError(f"{len(words)} tiles are more than the {len(tiles)} that are free")
        self._free[tiles] = False
        self.tile_of[words] = tiles
        places = self._places[tiles]
        if self._virtual is not None:
            places = self._virtual[np.where(words < self.shown, words, self.shown + tiles)]
        self.table[words] = places
        self.revision += 1
