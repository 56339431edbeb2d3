"""Tables of aliases: choosing one of many with given probabilities in constant time (Walker 1974; Vose 1991).

All probabilities are whole numbers of units, 2^-32 of an entry. So the table is exact: what an entry and those that
have it as their alias give a number sums to its units, without any rounding, and a shader that compares 32 random
bits with a threshold draws with exactly these probabilities. `shaders/alias.glsl` reads the table.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

Float64 = NDArray[np.float64]
Int64 = NDArray[np.int64]
Uint32 = NDArray[np.uint32]

UNIT_BITS = 32
MAX_WEIGHTS = 2**24
"""The largest number of weights: the sum of all units, 2^56, stays far from the largest integer."""


@dataclass(frozen=True, eq=False)
class AliasTable:
    """A table of 2^k entries for `count` numbers, the entries from `count` on having no units of their own.

    `threshold` and `alias` are (entries,) uint32: the entry stands for itself with the probability threshold / 2^32, or
    always where its alias is itself. `units` (count,) int64 are the numbers' probabilities, in 2^-32 of an entry.
    """

    threshold: Uint32
    alias: Uint32
    units: Int64

    @property
    def count(self) -> int:
        """The number of weights that the table was made of."""
        return len(self.units)

    @property
    def probability(self) -> Float64:
        """The probabilities (count,) float64 with which the numbers are drawn; they sum to 1 exactly."""
        return self.units / (len(self.threshold) * 2.0**UNIT_BITS)

    def words(self) -> Uint32:
        """Return (entries, 4) uint32 for the shader: threshold, alias, and as floats the probabilities of both."""
        probability = np.zeros(len(self.threshold), np.float32)
        probability[: self.count] = self.probability
        bits = probability.view(np.uint32)
        return np.stack([self.threshold, self.alias, bits, bits[self.alias]], axis=1)


def alias_table(weights: ArrayLike) -> AliasTable:
    """Return the table for weights (N,) that are not negative, with N from 1 to 2^24.

    Probabilities below that of an entry, 1 / entries, differ from their weights' shares by 2^-32 of it at most,
    larger ones by 2^-31 of themselves; a weight above 0 has at least one unit.

    Raises:
        ValueError: no weights or too many, one that is negative or not finite, or all of them 0.
    """
    all_weights = np.asarray(weights, np.float64)
    if all_weights.ndim != 1 or not 1 <= all_weights.size <= MAX_WEIGHTS:
        raise ValueError(
            f"a table of aliases has 1 to {MAX_WEIGHTS} weights in a row, not {all_weights.shape}"
        )
    if not (np.isfinite(all_weights).all() and all_weights.min() >= 0):
        raise ValueError("a weight is finite and not negative")
    if not all_weights.any():
        raise ValueError("one weight at least is above 0: nothing can be drawn by weights of 0")
    entries = 1 << (all_weights.size - 1).bit_length()
    units = _whole_units(all_weights, entries << UNIT_BITS)
    padded = np.zeros(entries, np.int64)
    padded[: all_weights.size] = units
    threshold, alias = _pair_up(padded)
    return AliasTable(threshold, alias, units)


def _whole_units(weights: Float64, total: int) -> Int64:
    """Return whole numbers in proportion to weights that sum to `total`: rounded down, then the largest rests up."""
    share = weights / weights.max()  # a sum of large weights could overflow
    share = share / share.sum() * float(total)
    units = np.floor(share).astype(np.int64)
    missing = total - int(units.sum())
    if 0 < missing <= len(units):
        units[np.argpartition(units - share, missing - 1)[:missing]] += 1
    # What lifts tiny weights to one unit, and what rounding of the shares left, is taken from all large ones alike.
    units = np.where((weights > 0) & (units == 0), 1, units)
    over = int(units.sum()) - total
    large = units >= 1 << UNIT_BITS
    until = np.cumsum(units[large])
    units[large] -= np.diff(np.rint(over * (until / until[-1])).astype(np.int64), prepend=0)
    units[np.argmax(units)] += total - int(units.sum())
    return units


def _pair_up(units: Int64) -> tuple[Uint32, Uint32]:
    """Return thresholds and aliases (entries,), where the units sum to 2^32 for each entry.

    Small entries, in order, take what they lack from large ones, in order: each from the first that still has more
    than its own entry holds. A large one that has given away more than its surplus lacks something in turn, and takes
    it from the next. So everything follows from two running sums, of what is lacking and of what is left over
    (Hübschle-Schneider and Sanders 2019, "Parallel Weighted Random Sampling"), and no step depends on the one before.
    """
    full = 1 << UNIT_BITS
    small, large = np.flatnonzero(units < full), np.flatnonzero(units >= full)
    threshold, alias = units.copy(), np.arange(len(units))
    lacking, surplus = np.cumsum(full - units[small]), np.cumsum(units[large] - full)
    before = np.concatenate([[0], lacking])[:-1]
    alias[small] = large[np.searchsorted(surplus, before, side="right")]
    threshold[large] = full
    # The first small entry after which more is gone than large entries up to this one had left over. Where nothing was
    # missing just before, the next large entry gave instead.
    taker = np.searchsorted(lacking, surplus, side="right")
    short = np.flatnonzero(taker < len(small))
    short = short[before[taker[short]] < surplus[short]]
    threshold[large[short]] = full + surplus[short] - lacking[taker[short]]
    alias[large[short]] = large[short + 1]
    # A full entry is its own alias, whatever its threshold, which does not fit 32 bits.
    return np.minimum(threshold, full - 1).astype(np.uint32), alias.astype(np.uint32)
