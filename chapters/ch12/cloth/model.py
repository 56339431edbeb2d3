"""The model of a cloth for the GPU and its twin in numpy: springs by colour, springs and triangles by particle.

Sums of floating-point numbers depend on their order, so the order is part of the model. The GPU and the twin add the
forces on a particle in the order of these arrays: those of its springs, and those of its triangles.

XPBD moves both particles of a spring, so springs that share a particle cannot move at once. Springs of one colour share
no particle. First fit gives each spring, in order, the lowest colour that neither of its particles has yet. That takes
at most 2 d - 1 colours where a particle has d springs, and about d for a grid of Provot's springs.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .build import areas
from .types import Cloth

Floats = NDArray[np.floating[Any]]
Ints = NDArray[np.integer[Any]]


@dataclass(frozen=True)
class Incidence:
    """Numbers by particle: those of particle i are `entries[starts[i] : starts[i + 1]]`, in rising order."""

    starts: Ints
    entries: Ints


@dataclass(frozen=True)
class Model:
    """A cloth as arrays: `springs` (S, 2) are sorted by colour, and colour c begins at `color_starts[c]`, (C + 1,).

    `rest` (S,) are lengths at rest in metres, `rest_squared` (S,) their squares, `stiffness` (S,) newtons a metre.
    `inverse_masses` (P,) are 0 for held particles, `third_masses` (T,) a third of the mass of each triangle.
    """

    cloth: Cloth
    positions: Floats
    inverse_masses: Floats
    springs: Ints
    color_starts: Ints
    rest: Floats
    rest_squared: Floats
    stiffness: Floats
    triangles: Ints
    third_masses: Floats
    springs_of: Incidence
    triangles_of: Incidence

    @property
    def colors(self) -> int:
        """The number of colours: an iteration of XPBD has one stage of constraints for each."""
        return len(self.color_starts) - 1


def incidence(tuples: Ints, count: int) -> Incidence:
    """Return the rows of `tuples` (N, k) that contain each of `count` numbers; a row with a number twice comes
    twice."""
    flat = tuples.reshape(-1)
    order = np.argsort(flat, kind="stable")
    starts = np.zeros(count + 1, np.int64)
    np.cumsum(np.bincount(flat, minlength=count), out=starts[1:])
    return Incidence(starts, order // tuples.shape[1])


def model_of(cloth: Cloth, dtype: Any = np.float32) -> Model:
    """Return the model of a cloth, rounded once to `dtype`."""
    colors = color_springs(cloth.springs, len(cloth.positions))
    order = np.argsort(colors, kind="stable")
    springs = cloth.springs[order].astype(np.int64)
    positions = cloth.positions.astype(dtype)
    rest, rest_squared = _rest_lengths(cloth, springs, cloth.rest[order], positions)
    inverse = np.zeros(len(cloth.masses))
    np.divide(1.0, cloth.masses, out=inverse, where=cloth.masses > 0)
    starts = np.zeros(int(colors.max(initial=-1)) + 2, np.int64)
    np.cumsum(np.bincount(colors), out=starts[1:])
    triangles = cloth.triangles.astype(np.int64)
    return Model(
        cloth=cloth,
        positions=positions,
        inverse_masses=inverse.astype(dtype),
        springs=springs,
        color_starts=starts,
        rest=rest,
        rest_squared=rest_squared,
        stiffness=cloth.stiffness[cloth.kinds[order]].astype(dtype),
        triangles=triangles,
        third_masses=(areas(cloth.positions, triangles) * (cloth.kg_per_m2 / 3)).astype(dtype),
        springs_of=incidence(springs, len(positions)),
        triangles_of=incidence(triangles, len(positions)),
    )


def _rest_lengths(cloth: Cloth, springs: Ints, rest: Floats, positions: Floats) -> tuple[Floats, Floats]:
    """Return lengths at rest and their squares.

    If the length at rest is the modelled one, both come from the rounded positions, by the operations of the
    simulation. The spring then pulls with exactly 0 there, and cloth without weight stays where it is to the bit.
    """
    apart = positions[springs[:, 1]] - positions[springs[:, 0]]
    squared = apart[:, 0] * apart[:, 0] + apart[:, 1] * apart[:, 1] + apart[:, 2] * apart[:, 2]
    exact = np.linalg.norm(cloth.positions[springs[:, 1]] - cloth.positions[springs[:, 0]], axis=1)
    modelled = np.abs(exact - rest) <= 1e-9 * exact
    stated = rest.astype(positions.dtype)
    return np.where(modelled, np.sqrt(squared), stated), np.where(modelled, squared, stated * stated)


def color_springs(springs: NDArray[np.integer[Any]], particles: int) -> NDArray[np.int32]:
    """Return (S,) the colour of each spring, from 0; `springs` are (S, 2) pairs of `particles` particles.

    The colours of a particle are the bits of one integer, so the lowest free colour is found without a search: a
    million springs take about a second.
    """
    taken = [0] * particles
    bits = []
    for a, b in zip(springs[:, 0].tolist(), springs[:, 1].tolist(), strict=True):
        both = taken[a] | taken[b]
        bit = ~both & (both + 1)
        taken[a] |= bit
        taken[b] |= bit
        bits.append(bit)
    lengths = map(int.bit_length, bits)  # colours beyond 64 work, too: Python's integers have any length
    return np.fromiter(lengths, np.int32, len(bits)) - 1
