"""Which tiles of which faces have memory in a frame, from what a picture needed. No device.

A picture needs the tiles that its filters read, and for each lamp a resolution (rule.py). Tiles that are new are given
to the most important lights first, at most `page_budget` a frame. What waits is drawn with a coarser face until then.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..shadows.model import CUBE_FACES, Places
from .lamps import Int64, Lamps, level_of_side, whole_costs
from .pool import TilePool

KEPT = 4
"""Frames for which a tile is kept that no picture has needed: cameras turn back."""

MOST_SPARE = 64
"""Tiles of a large pool that sizes leave free while lights come and go."""

Bools = NDArray[np.bool_]


class Need(NamedTuple):
    """What a picture needs: (S,) texels along a face of each slot's light, NaN if it says nothing about it, and (W,)
    which words of the table are read, those of lamps at the highest level."""

    resolution: NDArray[np.float64]
    tiles: Bools


def read_report(words: NDArray[np.uint32], places: Places, detail: float) -> Need:
    """Return what the kernels reported (report.glsl); `detail` is the factor of resolutions."""
    asked = words[: places.lamps].view(np.float32).astype(np.float64) * detail
    bits = np.unpackbits(words[places.lamps :].view(np.uint8), count=places.coarse_word, bitorder="little")
    return Need(np.where(asked > 0, asked, np.nan), bits.view(np.bool_))


class Residency:
    """Gives tiles of a pool to faces. The levels of lamps change with their tiles."""

    def __init__(
        self, pool: TilePool, places: Places, lamps: Lamps, budget: int, reserve: Callable[[int], int]
    ) -> None:
        self._pool, self._places, self._lamps, self._budget = pool, places, lamps, budget
        self._reserve = reserve
        lamp = np.arange(places.lamps)
        cascades = np.arange(places.suns * places.cascades)
        # Suns come first. The coarse page of a sun counts as its first cascade's.
        self._owner = np.concatenate(
            [
                np.repeat(cascades, places.sun_side**2),
                np.repeat(len(cascades) + lamp, places.lamp_words),
                np.arange(places.suns) * places.cascades,
                len(cascades) + lamp,
            ]
        ).astype(np.int64)
        self._owner = np.tile(self._owner, 2)  # also of what is kept without movers
        self._suns = len(cascades)
        self._age = np.zeros(2 * places.words, np.int64)
        self.assigned = np.zeros(0, np.intp)
        """The words that got a tile in this frame."""
        self.waits = self.ages = False
        """Whether any tile waits for its turn; whether any is kept that is not needed."""
        self._without_suns = False

    def _costs(self, by_level: list[tuple[int, Bools]]) -> Int64:
        """Return (S, L) the tiles that each slot's light takes at each level."""
        places, lamps = self._places, self._lamps
        costs = whole_costs(lamps.counts, lamps.highest, places.coarse)
        for level, needed in by_level:
            costs[:, level] = places.coarse + needed.sum(axis=(1, 2, 3))
        return costs

    def _by_level(self, tiles: Bools) -> list[tuple[int, Bools]]:
        """Return for each level from 2 on which tiles (S, 6, rows, columns) of their faces lamps need."""
        places, side = self._places, self._places.lamp_side
        finest: Bools = tiles[places.lamp_word : places.coarse_word].reshape(-1, CUBE_FACES, side, side)
        finest = finest & (np.arange(CUBE_FACES) < self._lamps.counts[:, None])[..., None, None]
        levels: list[tuple[int, Bools]] = []
        while side >= 1:
            levels.append((level_of_side(side), finest))
            side //= 2
            if side:
                finest = np.any(finest.reshape(-1, CUBE_FACES, side, 2, side, 2), axis=(3, 5))
        return levels

    def _words_of(self, levels: Int64, suns: Bools, by_level: list[tuple[int, Bools]]) -> Bools:
        """Return (W,) which words of the table want a tile when lamps have these levels."""
        places = self._places
        wanted = np.zeros(places.words, bool)
        wanted[: places.lamp_word] = suns
        of_lamps = wanted[places.lamp_word : places.coarse_word].reshape(-1, CUBE_FACES, places.lamp_side**2)
        for level, needed in by_level:
            at = levels == level
            if at.any():
                chosen = needed[at].reshape(int(at.sum()), CUBE_FACES, -1)
                of_lamps[at, :, : chosen.shape[2]] = chosen
        coarse = wanted[places.coarse_word :]
        coarse[: places.suns] = places.coarse and places.sun_side > 0 and not self._without_suns
        coarse[places.suns :] = levels > 0 if places.coarse else levels == 1
        return wanted

    @property
    def owners(self) -> int:
        """The number of cascades of all suns and of slots of lamps."""
        return self._suns + self._places.lamps

    def follow(self, need: Need, now: bool, mixed: Bools) -> bool:
        """Choose levels and tiles; return whether any of them is another one.

        With `now` all tiles are given at once, and what was given up is free: no frame in flight reads it. `mixed`
        (`owners`,) says which of these meet casters that move: what they show is kept without these as well, as far
        as tiles are left.
        """
        pool, lamps, places = self._pool, self._lamps, self._places
        of_suns, by_level = need.tiles[: places.lamp_word], self._by_level(need.tiles)
        suns = int(of_suns.sum()) + places.suns * (places.coarse and places.sun_side > 0)
        self._without_suns = suns > pool.tiles  # the device has refused memory
        if self._without_suns:
            of_suns, suns = np.zeros_like(of_suns), 0
        # Some tiles stay free, so that a light that comes does not wait for another one to give up its own.
        spare = 0 if now else min(MOST_SPARE, pool.tiles // 16)
        levels = lamps.wanted(need.resolution, self._costs(by_level), pool.tiles - suns - spare)
        wanted = self._words_of(levels, of_suns, by_level)
        wanted = np.concatenate([wanted, self._kept(wanted, mixed, spare)])
        held = pool.tile_of >= 0
        asked = resized = self._of_lamps(levels != lamps.levels)
        new = wanted & (~held | resized)
        # While both sizes of a light are held, more is needed than in the end.
        there = self._reserve(min(pool.tiles, int(new.sum()) + int(held.sum()) + int(pool.is_waiting.sum())))
        if there < int(wanted.sum()):  # the device refuses memory: all sizes follow from what there is
            pool.limit(there)
            return self.follow(need, now, mixed)
        before = pool.revision, lamps.levels
        self.waits = self.ages = False
        if now:
            pool.release(np.flatnonzero(held & (~wanted | resized)), now=True)
            self._age[:] = 0
        else:
            levels, new = self._admitted(levels, new)
            resized = self._of_lamps(levels != lamps.levels)
            self._give_up(held & resized, held & ~wanted & ~asked)
        self.assigned = np.flatnonzero(new)
        if len(self.assigned):
            pool.assign(self.assigned)
        lamps.levels = levels
        return before[0] != pool.revision or not np.array_equal(before[1], levels)

    def _kept(self, shown: Bools, mixed: Bools, spare: int) -> Bools:
        """Return (W,) which of the words that are `shown` are kept as well: of the first owners that have room."""
        owner = self._owner[: self._places.words]
        cost = np.bincount(owner[shown], minlength=self.owners) * mixed
        room = self._pool.tiles - int(shown.sum()) - spare
        if int(cost.sum()) > room:
            order = self._by_weight()
            mixed = mixed.copy()
            mixed[order] &= np.cumsum(cost[order]) <= room
        return shown & mixed[owner]

    def _by_weight(self) -> Int64:
        """Return the owners, the most important first: cascades, then slots."""
        weights = np.concatenate([np.full(self._suns, np.inf), self._lamps.weights])
        return np.argsort(-weights, kind="stable")

    def _of_lamps(self, chosen: Bools) -> Bools:
        """Return (2 W,) the words of some lamps' faces, coarse pages apart: these stay when a size changes."""
        places = self._places
        words = np.zeros((2, places.words), bool)
        words[:, places.lamp_word : places.coarse_word] = np.repeat(chosen, places.lamp_words)
        return words.reshape(-1)

    def _admitted(self, levels: Int64, new: Bools) -> tuple[Int64, Bools]:
        """Return the levels and the new words that this frame has room for.

        Coarse pages come first, whatever the budget is. A light whose size changes has all of its tiles at once: a face
        has one size.
        """
        pool, lamps, places = self._pool, self._lamps, self._places
        if int(new.sum()) <= min(self._budget, pool.free):
            return levels, new
        self.waits = True
        order, coarse = self._by_weight(), np.zeros_like(new)
        coarse[places.coarse_word : places.words] = new[places.coarse_word : places.words]
        count = np.bincount(self._owner[coarse], minlength=self.owners)
        covered = np.ones(self.owners, bool)
        covered[order] = (np.cumsum(count[order]) <= pool.free) | (count[order] == 0)
        coarse &= covered[self._owner]
        room = pool.free - int(coarse.sum())
        new = new & ~coarse & covered[self._owner]
        cost = np.bincount(self._owner[new], minlength=self.owners)
        order = order[cost[order] > 0]
        along = np.cumsum(cost[order])
        turn = along <= min(self._budget, room)
        turn[:1] = cost[order[:1]] <= room  # more than the budget, but on its own
        admitted = covered.copy()
        admitted[order] = turn
        of_lamps = admitted[self._suns :]
        stuck = len(order) > 0 and not turn.any() and not pool.waiting
        held = np.where(covered[self._suns :] & (levels > 0), np.maximum(lamps.levels, 1), lamps.levels)
        levels = np.where(of_lamps, levels, held)
        if stuck:  # a light that changes its size needs room for both: it has its coarse page in between
            first = order[0] - self._suns
            if first >= 0:
                levels[first] = min(int(levels[first]), 1)
        return levels, coarse | (new & admitted[self._owner])

    def _give_up(self, resized: Bools, unneeded: Bools) -> None:
        """Give up the tiles of faces that have another size, and those that were not needed for some frames."""
        self._age = np.where(unneeded, self._age + 1, 0)
        old = unneeded & ((self._age > KEPT) | self.waits)
        self.ages = bool((unneeded & ~old).any())
        gone = np.flatnonzero(resized | old)
        if len(gone):
            self._pool.release(gone)
            self._age[gone] = 0
