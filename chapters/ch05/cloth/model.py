"""A cloth as both the GPU and its twin in numpy compute with it: springs by colour, and what each particle gathers.

Sums of floating-point numbers depend on their order, so the order is part of the model: a particle adds the pulls of
its springs by their place here, and those of its triangles by theirs, wherever it is simulated.

XPBD moves both particles of a spring, so springs that share a particle cannot move at once. Each spring has a colour;
springs of one colour share no particle. First fit gives each spring, in order, the lowest colour that neither of its
particles has yet: at most 2 d - 1 colours where a particle has d springs, and about d for a grid of Provot's springs.
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
    """What meets at each particle: `entries[starts[i] : starts[i + 1]]` are the numbers for particle i, rising."""

    starts: Ints
    entries: Ints


@dataclass(frozen=True)
class Model:
    """`springs` (S, 2) lie side by side by colour, `color_starts` (C + 1,) says where each colour begins.

    `rest` and `rest_squared` are (S,) lengths, `stiffness` (S,) newtons a metre, `inverse_masses` (P,) 0 where held,
    `third_masses` (T,) a third of the mass of each triangle.
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
        """How many stages of constraints an iteration of XPBD has."""
        return len(self.color_starts) - 1


def incidence(tuples: Ints, count: int) -> Incidence:
    """Return which of the (N, k) `tuples` name each of `count` numbers; one that names it twice is there twice."""
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

    A spring that is as long as it was modelled takes both from the rounded positions, by the operations of the
    simulation: then it pulls with exactly 0 there, and what hangs without weight stays where it is to the bit.
    """
    apart = positions[springs[:, 1]] - positions[springs[:, 0]]
    squared = apart[:, 0] * apart[:, 0] + apart[:, 1] * apart[:, 1] + apart[:, 2] * apart[:, 2]
    exact = np.linalg.norm(cloth.positions[springs[:, 1]] - cloth.positions[springs[:, 0]], axis=1)
    modelled = np.abs(exact - rest) <= 1e-9 * exact
    stated = rest.astype(positions.dtype)
    return np.where(modelled, np.sqrt(squared), stated), np.where(modelled, squared, stated * stated)


def color_springs(springs: NDArray[np.integer[Any]], particles: int) -> NDArray[np.int32]:
    """Return (S,) the colour of each spring, from 0; `springs` are (S, 2) pairs of `particles` particles.

    The colours a particle has are the bits of one integer, so that the lowest free one is found without a search:
    a million springs take about a second.
    """
    taken = [0] * particles
    bits = []
    for a, b in zip(springs[:, 0].tolist(), springs[:, 1].tolist(), strict=True):
        both = taken[a] | taken[b]
        bit = ~both & (both + 1)
        taken[a] |= bit
        taken[b] |= bit
        bits.append(bit)
    lengths = map(int.bit_length, bits)  # a colour beyond 64 is as good as any
    return np.fromiter(lengths, np.int32, len(bits)) - 1
