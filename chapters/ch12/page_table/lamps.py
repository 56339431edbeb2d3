"""The local lights that cast shadows: a slot for each of the most important ones, and the size of their faces.

A light keeps its slot while it stays among the chosen, so that others come and go without its maps being drawn again.
Its faces have one size, by level: 0 no map, 1 the coarse page, 2 faces of one tile, and twice the texels along a face
for each level above. The coarse page is a single tile: all six faces of a cube, or the one face of a spot.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..shadows.model import TILE

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
Float64 = NDArray[np.float64]


def level_of_side(tiles: int) -> int:
    """Return the level of faces with this many tiles along a side, a power of two."""
    return 1 + tiles.bit_length()


def sizes_of(levels: Int64, counts: Int64) -> Int64:
    """Return the texels along a face of lights with `counts` faces."""
    least = np.where(counts == 1, TILE, COARSE)
    finer = TILE << np.maximum(levels - 2, 0)
    return np.where(levels == 0, 0, np.where(levels == 1, least, finer))


def level_above(resolution: Float64, counts: Int64, most: int) -> Int64:
    """Return the lowest level that has `resolution` texels along a face, at most `most`."""
    largest = TILE << max(most - 2, 0)
    with np.errstate(over="ignore"):
        wanted = np.clip(np.nan_to_num(resolution, posinf=largest), 1, largest)
    finer = 2 + np.ceil(np.log2(np.maximum(wanted, TILE) / TILE)).astype(np.int64)
    least = np.where(counts == 1, TILE, COARSE)
    return np.where(wanted <= least, 1, finer)


def lower(levels: Int64, counts: Int64) -> Int64:
    """Return the next lower levels. A spot has no level 2: its coarse page is as fine."""
    return np.where((counts == 1) & (levels == 3), 1, np.maximum(levels - 1, 0))


def whole_costs(counts: Int64, most: int, coarse: bool) -> Int64:
    """Return (N, most + 1) the tiles of lights at each level if all tiles of their faces have memory.

    With `coarse` each light has its coarse page besides.
    """
    levels = np.arange(most + 1)
    finer = coarse + counts[:, None] * 4 ** np.maximum(levels - 2, 0)
    return np.where(levels >= 2, finer, levels)


def _at(costs: Int64, levels: Int64) -> Int64:
    return np.take_along_axis(costs, levels[:, None], axis=1)[:, 0]


def fitted(levels: Int64, counts: Int64, importance: Float64, costs: Int64, most: int) -> Int64:
    """Return levels with at most `most` tiles together; `costs` (N, L) are the tiles of each light at each level.

    Of the lights with the most tiles, as many as it takes get the next lower level, the least important ones first;
    then of those that have the most tiles by now, and so on.
    """
    order, levels = np.argsort(importance, kind="stable"), levels.copy()
    while True:
        cost = _at(costs, levels)
        excess = int(cost.sum()) - most
        if excess <= 0:
            return levels
        below = lower(levels, counts)
        saved = np.where(cost == cost.max(), cost - _at(costs, below), 0)[order]
        if not (saved > 0).any():  # the next level has as many tiles
            lowered = order[cost[order] == cost.max()]
        else:
            last = int(np.searchsorted(np.cumsum(saved), excess))
            lowered = order[: last + 1][saved[: last + 1] > 0]
        levels[lowered] = below[lowered]


def spread(
    resolution: Float64, wanted: Int64, counts: Int64, importance: Float64, costs: Int64, most: int
) -> Int64:
    """Return levels for at most `most` tiles, if the least take no more: all resolutions lose the same factor.

    Factors are powers of the root of 2. The most important lights keep the levels of the next larger factor, as far as
    there are tiles.
    """
    finer, factor, highest = wanted, 1.0, costs.shape[1] - 1
    while int(_at(costs, finer).sum()) > most and factor > 1e-3:
        factor /= np.sqrt(2.0)
        coarser = np.minimum(finer, level_above(np.minimum(resolution, MOST) * factor, counts, highest))
        cost = _at(costs, finer)
        order = np.argsort(importance, kind="stable")
        saved = np.cumsum((cost - _at(costs, coarser))[order])
        last = int(np.searchsorted(saved, int(cost.sum()) - most))
        if last < len(order):
            lowered = order[: last + 1]
            mixed = finer.copy()
            mixed[lowered] = coarser[lowered]
            return mixed
        finer = coarser
    return finer


class Lamps:
    """The slots, and which light each of them holds."""

    def __init__(self, slots: int, highest: int) -> None:
        self.highest = highest
        """The highest level."""
        self.places = np.full(slots, -1, np.intp)
        """(S,) The place in the records of the light in each slot, -1 for none."""
        self.counts: Int64 = np.zeros(slots, np.int64)
        self.levels: Int64 = np.zeros(slots, np.int64)
        self.weights: Float64 = np.zeros(slots)
        self.since: Int64 = np.zeros(slots, np.int64)
        """(S,) The frame from which on a slot has held its light."""
        self.lowered = 0
        """Lights that got fewer texels than the picture asks for."""

    @property
    def active(self) -> NDArray[np.intp]:
        """Slots whose light has a map."""
        return np.flatnonzero((self.places >= 0) & (self.levels > 0))

    @property
    def sizes(self) -> Int64:
        """(S,) Texels along a face."""
        return sizes_of(self.levels, self.counts)

    def forget(self) -> None:
        """Empty all slots."""
        self.places[:], self.levels[:], self.counts[:] = -1, 0, 0

    def choose(self, importance: Float64, faces: Int64, frame: int) -> None:
        """Choose the most important lights; those that are new have level 0.

        `importance` (L,) of all records, 0 for those that cast no shadows; `faces` (L,) how many each has.
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
        counts = np.where(places >= 0, faces[places], 0)
        new = (places != self.places) | (counts != self.counts)
        self.since = np.where(new, frame, self.since)
        self.levels = np.where(new, 0, self.levels)
        self.places, self.counts = places, counts
        self.weights = np.where(places >= 0, rank[places], 0.0)

    def wanted(self, resolution: Float64, costs: Int64, most: int) -> Int64:
        """Return the level of each slot for `most` tiles together.

        `resolution` (S,) texels along a face, NaN for a light that keeps its level; `costs` (S, L) tiles at each level.
        """
        held = self.places >= 0
        sizes = self.sizes
        known = np.where(np.isnan(resolution), np.maximum(sizes, 1), resolution)
        wanted = level_above(known, self.counts, self.highest)
        keeps = (self.levels > wanted) & (known > SHRINKS * sizes)
        wanted = np.where(held, np.where(keeps, self.levels, wanted), 0)
        # What has more than the least keeps it before what has not.
        weight = self.weights * np.where(self.levels > 1, KEPT, 1.0)
        asked = np.maximum(known, sizes * SHRINKS)
        levels = spread(asked, wanted, self.counts, weight, np.where(held[:, None], costs, 0), most)
        levels = fitted(levels, self.counts, weight, np.where(held[:, None], costs, 0), most)
        self.lowered = int((levels < wanted).sum())
        return levels
