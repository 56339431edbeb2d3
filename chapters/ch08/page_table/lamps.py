"""The local lights that cast shadows: a slot for each of the most important ones, and tiles for their faces. No device.

A light keeps its slot while it stays among the chosen, so that others come and go without its maps being drawn again.
Its faces have one size: as fine as the picture asks for, or that with which all six faces of a cube fit into a single
tile (COARSE).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..shadows.layout import tiles_of
from ..shadows.model import CUBE_FACES, TILE
from .pool import TilePool

COARSE = 40
"""Texels of the six faces of a cube that share a tile, three in a row."""

COARSE_STEP = 42

MOST = 8192.0
"""The highest resolution that counts when lights share too few tiles."""

KEPT = 1.5
"""How much more important a light has to be than one that has a slot, to take it."""

SHRINKS = 0.35
"""The part of its size below which a light's resolution has to fall before its faces become smaller."""

Int64 = NDArray[np.int64]


def tiles_for(sizes: Int64, counts: Int64) -> Int64:
    """Return the tiles of lights with `counts` faces of `sizes` texels."""
    return np.where(sizes == 0, 0, np.where(sizes == COARSE, 1, counts * tiles_of(sizes)))


def least_size(counts: Int64) -> Int64:
    """Return the smallest size of lights with `counts` faces: that with one tile."""
    return np.where(counts == 1, TILE, COARSE)


def size_above(resolution: NDArray[np.float64], counts: Int64, largest: int) -> Int64:
    """Return the smallest size that has `resolution` texels: a power of two of tiles, or the least."""
    with np.errstate(over="ignore"):
        wanted = np.clip(np.nan_to_num(resolution, posinf=largest), 1, largest)
    powers = (2 ** np.ceil(np.log2(np.maximum(wanted, TILE)))).astype(np.int64)
    return np.where(wanted <= least_size(counts), least_size(counts), powers)


def smaller_size(sizes: Int64, counts: Int64) -> Int64:
    """Return the next smaller sizes: halves down to a tile a face, then one tile for all faces, then nothing."""
    least = least_size(counts)
    return np.where(sizes <= least, 0, np.where(sizes > TILE, sizes // 2, least))


def fitted(sizes: Int64, counts: Int64, importance: NDArray[np.float64], most: int) -> Int64:
    """Return sizes with at most `most` tiles together.

    Of the lights with the most tiles, as many as it takes get the next smaller size, the least important ones first;
    then of those that have the most tiles by now, and so on.
    """
    order, sizes = np.argsort(importance, kind="stable"), sizes.copy()
    while True:
        cost = tiles_for(sizes, counts)
        excess = int(cost.sum()) - most
        if excess <= 0:
            return sizes
        smaller = smaller_size(sizes, counts)
        saved = np.where(cost == cost.max(), cost - tiles_for(smaller, counts), 0)[order]
        last = int(np.searchsorted(np.cumsum(saved), excess))
        lowered = order[: last + 1][saved[: last + 1] > 0]
        sizes[lowered] = smaller[lowered]


def spread(
    resolution: NDArray[np.float64],
    wanted: Int64,
    counts: Int64,
    importance: NDArray[np.float64],
    most: int,
    largest: int,
) -> Int64:
    """Return sizes for at most `most` tiles, if the least sizes take no more: all resolutions lose the same factor.

    Factors are powers of the root of 2. The most important lights keep the sizes of the next larger factor, as far as
    there are tiles.
    """
    finer, factor = wanted, 1.0
    while int(tiles_for(finer, counts).sum()) > most and factor > 1e-3:
        factor /= np.sqrt(2.0)
        coarser = np.minimum(finer, size_above(np.minimum(resolution, MOST) * factor, counts, largest))
        cost = tiles_for(finer, counts)
        order = np.argsort(importance, kind="stable")
        saved = np.cumsum((cost - tiles_for(coarser, counts))[order])
        last = int(np.searchsorted(saved, int(cost.sum()) - most))
        if last < len(order):
            lowered = order[: last + 1]
            mixed = finer.copy()
            mixed[lowered] = coarser[lowered]
            return mixed
        finer = coarser
    return finer


class Lamps:
    """The slots. Words of the table of slot s begin at `first_word` + s * `stride`."""

    def __init__(self, slots: int, largest: int, pool: TilePool, first_word: int) -> None:
        self.largest, self._pool, self._first_word = largest, pool, first_word
        self.places = np.full(slots, -1, np.intp)
        """(S,) The place in the records of the light in each slot, -1 for none."""
        self.sizes: Int64 = np.zeros(slots, np.int64)
        self.counts: Int64 = np.zeros(slots, np.int64)
        self.lowered = 0
        """Lights that got fewer texels than the picture asks for."""

    @staticmethod
    def stride_of(largest: int) -> int:
        """Return the words of the table of a slot."""
        return CUBE_FACES * int(tiles_of(np.array([largest]))[0])

    @property
    def active(self) -> NDArray[np.intp]:
        """Slots that hold a light."""
        return np.flatnonzero(self.places >= 0)

    @property
    def first_words(self) -> Int64:
        """(S,) The first word of each slot."""
        return self._first_word + np.arange(len(self.places)) * self.stride_of(self.largest)

    def forget(self) -> None:
        """Empty all slots."""
        self._take(np.full_like(self.places, -1), np.zeros_like(self.sizes), np.zeros_like(self.counts))

    def follow(
        self, importance: NDArray[np.float64], faces: Int64, resolution: NDArray[np.float64], most: int
    ) -> bool:
        """Choose lights and sizes; return whether any slot holds something else.

        `importance` (L,) of all records, 0 for those that cast no shadows; `faces` (L,) how many each has;
        `resolution` (L,) texels along a face; `most` tiles for all of them together.
        """
        held = self.places >= 0
        rank = importance.copy()
        rank[self.places[held]] *= KEPT
        order = np.argsort(-rank, kind="stable")[: len(self.places)]
        order = order[rank[order] > 0]
        chosen = np.zeros(len(rank), bool)
        chosen[order] = True
        places = np.where(held & chosen[np.where(held, self.places, 0)], self.places, -1)
        stays = np.zeros(len(rank), bool)
        stays[places[places >= 0]] = True
        arriving = order[~stays[order]]
        places[np.flatnonzero(places < 0)[: len(arriving)]] = arriving
        filled = np.flatnonzero(places >= 0)
        at = places[filled]
        counts = faces[at]
        wanted = size_above(resolution[at], counts, self.largest)
        before = np.where((places == self.places)[filled], self.sizes[filled], 0)
        keeps = (before > wanted) & (resolution[at] > SHRINKS * before) & (counts == self.counts[filled])
        wanted = np.where(keeps, before, wanted)
        finer = before > least_size(counts)  # what has more than the least keeps it before what has not
        weight = rank[at] * np.where(finer, KEPT, 1.0)
        asked = np.maximum(resolution[at], before * SHRINKS)
        fitting = fitted(spread(asked, wanted, counts, weight, most, self.largest), counts, weight, most)
        self.lowered = int((fitting < wanted).sum())
        all_counts, all_sizes = np.zeros_like(self.counts), np.zeros_like(self.sizes)
        all_counts[filled], all_sizes[filled] = counts, fitting
        places = np.where(all_sizes > 0, places, -1)
        return self._take(places, all_sizes, np.where(all_sizes > 0, all_counts, 0))

    def _take(self, places: NDArray[np.intp], sizes: Int64, counts: Int64) -> bool:
        """Let slots hold these lights with faces of these sizes, and give them tiles."""
        changed = (places != self.places) | (sizes != self.sizes) | (counts != self.counts)
        if not changed.any():
            return False
        tiles, first = tiles_for(sizes, counts), self.first_words
        stride = np.arange(self.stride_of(self.largest))
        slots = np.flatnonzero(changed)
        self._pool.release((first[slots, None] + stride).reshape(-1))
        words = np.repeat(first[slots], tiles[slots])
        within = np.arange(len(words)) - np.repeat(np.cumsum(tiles[slots]) - tiles[slots], tiles[slots])
        self._pool.assign(words + within)
        self.places, self.sizes, self.counts = places, sizes, counts
        return True
