"""Blue noise by void-and-cluster (Ulichney 1993, "The void-and-cluster method for dither array generation").

A table (size, size) gives every texel a rank from 0 to size^2 - 1, each once. The texels below any rank are spread
evenly: the rank that follows lies in the largest void between them. Read as numbers in 0..1 the ranks are uniform to
the last one, their spectrum has next to no power at low frequencies, and the table repeats without a seam.

Voids and clusters are extrema of an energy: a Gaussian around each texel of the pattern, on the torus. Energies are
whole numbers, so that every processor makes the same table; ties go by a seeded order of the texels.
"""

from __future__ import annotations

from decimal import Decimal
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from common.images.png16 import encode_png16
from common.numerics.blue_noise import SIZE, TABLE
from common.paths import write_whole

Int64 = NDArray[np.int64]

SIGMA = Decimal("1.5")
"""Standard deviation of the Gaussian in texels, Ulichney's choice."""

TIE_BITS, ENERGY_BITS = 14, 42
"""Bits of the order that breaks ties, and above them of the largest energy of one texel. A full pattern has
2 pi sigma^2 = 14.1 times that energy, below 2^60."""

TAKEN = 1 << 61
"""Added to the energy of a texel in the pattern: no void is there."""

CHANNELS = 2
SEED = 1993


def gaussian(size: int) -> Int64:
    """Return (size, size) the energy around texel (0, 0) on the torus, in units of 2^TIE_BITS.

    `Decimal` rounds the exponential correctly, which a processor's library need not do.
    """
    near = np.minimum(np.arange(size), size - np.arange(size))
    squared = near[:, None] ** 2 + near**2
    scale = Decimal(1 << ENERGY_BITS)
    energies = {
        int(d): int((scale * (-Decimal(int(d)) / (2 * SIGMA**2)).exp()).to_integral_value())
        for d in np.unique(squared)
    }
    return np.vectorize(energies.__getitem__, otypes=[np.int64])(squared) << TIE_BITS


class Pattern:
    """Texels of a torus, some of them in the pattern, with the energy of that at each texel."""

    def __init__(self, size: int, seed: int) -> None:
        self.size = size
        self.inside = np.zeros(size * size, bool)
        # An order of all texels stands in the lowest bits: no two energies are equal.
        self.energy: Int64 = np.random.default_rng(seed).permutation(size * size).astype(np.int64)
        self._around = np.tile(gaussian(size), (2, 2))

    def copy(self) -> Pattern:
        other = object.__new__(Pattern)
        other.size, other._around = self.size, self._around
        other.inside, other.energy = self.inside.copy(), self.energy.copy()
        return other

    def put(self, texel: int) -> None:
        """Put `texel`, as row * size + column, into the pattern."""
        self._change(texel, 1)

    def take(self, texel: int) -> None:
        """Take `texel` out of the pattern."""
        self._change(texel, -1)

    def _change(self, texel: int, sign: int) -> None:
        row, column = divmod(texel, self.size)
        top, left = self.size - row, self.size - column
        shifted = self._around[top : top + self.size, left : left + self.size]
        self.energy += sign * shifted.reshape(-1)
        self.energy[texel] += sign * TAKEN
        self.inside[texel] = sign > 0

    def tightest_cluster(self) -> int:
        """Return the texel of the pattern with the largest energy: `TAKEN` lifts these above all others."""
        return int(self.energy.argmax())

    def largest_void(self) -> int:
        """Return the texel outside the pattern with the smallest energy."""
        return int(self.energy.argmin())


def first_count(size: int) -> int:
    """Return of how many texels the first pattern is: a tenth, where voids and clusters are both clear."""
    return max(size * size // 10, 1)


def first_pattern(size: int, seed: int) -> Pattern:
    """Return a random pattern whose tightest cluster went to the largest void until both were the same texel.

    Each move lowers the energy between the texels of the pattern, so the moves end.
    """
    pattern = Pattern(size, seed)
    for texel in np.random.default_rng([seed, 1]).choice(size * size, first_count(size), replace=False):
        pattern.put(int(texel))
    while True:
        cluster = pattern.tightest_cluster()
        pattern.take(cluster)
        void = pattern.largest_void()
        pattern.put(void)
        if void == cluster:
            return pattern


def void_and_cluster(size: int, seed: int) -> NDArray[np.uint16]:
    """Return the ranks (size, size) uint16 of one table; `size` is at most 128.

    Ranks below the first pattern's count go to its clusters, tightest last. The others fill voids. Ulichney's third
    phase, clusters of the texels that are left, is the second one: two energies that sum to a constant have extrema at
    the same texels.
    """
    if not 2 <= size <= 128:
        raise ValueError(f"a table has 2 to 128 texels a side, not {size}")
    pattern = first_pattern(size, seed)
    ranks = np.zeros(size * size, np.uint16)
    rest = pattern.copy()
    for rank in reversed(range(first_count(size))):
        texel = rest.tightest_cluster()
        rest.take(texel)
        ranks[texel] = rank
    for rank in range(first_count(size), size * size):
        texel = pattern.largest_void()
        pattern.put(texel)
        ranks[texel] = rank
    return ranks.reshape(size, size)


def source(number: int, size: int = SIZE) -> NDArray[np.uint16]:
    """Return the ranks (size, size, 2) of source `number`: two tables that have nothing to do with each other."""
    tables = [void_and_cluster(size, SEED + CHANNELS * number + channel) for channel in range(CHANNELS)]
    return np.stack(tables, axis=-1)


def write(path: Path = TABLE) -> int:
    """Write source 0 as a PNG of two channels with 16 bits, and return the bytes of the file."""
    data = encode_png16(source(0))
    path.parent.mkdir(parents=True, exist_ok=True)
    write_whole(path, data)
    return len(data)
