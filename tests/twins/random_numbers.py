"""Random numbers of a path tracer again: PCG in whole numbers, Owen's scrambling and Sobol's points from tables.

Functions take whole numbers from 0 to 2^32 - 1 and broadcast. Products are computed in 64 bits and cut, nothing wraps.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

Uint64 = NDArray[np.uint64]
Uint32 = NDArray[np.uint32]

CUT = np.uint64(0xFFFFFFFF)


def _u(x: ArrayLike) -> Uint64:
    return np.asarray(x, np.uint64) & CUT


def permuted(state: ArrayLike) -> Uint64:
    """Return PCG's output for states: shift by 4 to 19 places, exclusive or, product, exclusive or (RXS-M-XS)."""
    state = _u(state)
    word = ((state >> ((state >> np.uint64(28)) + np.uint64(4))) ^ state) * np.uint64(277803737) & CUT
    return (word >> np.uint64(22)) ^ word


def stepped(state: ArrayLike) -> Uint64:
    """Return the states after the given ones."""
    return (_u(state) * np.uint64(747796405) + np.uint64(2891336453)) & CUT


def pcg_hash(x: ArrayLike) -> Uint64:
    """Return the permutation of the state after `x`."""
    return permuted(stepped(x))


def seed_of(x: ArrayLike, y: ArrayLike, width: int, frame: ArrayLike) -> Uint64:
    """Return the state with which a pixel of a frame begins."""
    place = _u(_u(y) * np.uint64(width) + _u(x))
    return pcg_hash(_u(pcg_hash(place) + pcg_hash(pcg_hash(frame))))


def mirrored(x: ArrayLike) -> Uint64:
    """Return numbers with their 32 bits in the other order."""
    x, result = _u(x), np.zeros(np.shape(x), np.uint64)
    for bit in range(32):
        result |= (x >> np.uint64(bit) & np.uint64(1)) << np.uint64(31 - bit)
    return result


def sobol_plain(index: ArrayLike) -> tuple[Uint64, Uint64]:
    """Return the first two dimensions of Sobol's sequence without scrambling, as 32 bits after the binary point.

    By direction numbers (Joe and Kuo 2008, "Constructing Sobol Sequences with Better Two-Dimensional Projections"):
    for the first dimension v_k = 2^(31-k), for the second, of the polynomial x + 1, m_1 = 1 and m_k = 2 m_(k-1) xor
    m_(k-1).
    """
    index = _u(index)
    m = 1
    first, second = np.zeros(np.shape(index), np.uint64), np.zeros(np.shape(index), np.uint64)
    for k in range(32):
        chosen = (index >> np.uint64(k) & np.uint64(1)).astype(bool)
        first ^= np.where(chosen, np.uint64(1 << (31 - k)), np.uint64(0))
        second ^= np.where(chosen, np.uint64(m << (31 - k)), np.uint64(0))
        m = (m << 1) ^ m
    return first, second


def scrambled(x: ArrayLike, seed: ArrayLike) -> Uint64:
    """Return a nested uniform scramble of 32 bits after the binary point: highest bit first (Burley 2020)."""
    x, seed = mirrored(x), _u(seed)
    x ^= x * np.uint64(0x3D20ADEA) & CUT
    x = (x + seed) & CUT
    x = x * (seed >> np.uint64(16) | np.uint64(1)) & CUT
    x ^= x * np.uint64(0x05526C56) & CUT
    x ^= x * np.uint64(0x53A22864) & CUT
    return mirrored(x)


def sobol_bits(index: ArrayLike, pair: ArrayLike, seed: ArrayLike) -> Uint32:
    """Return points (..., 2) uint32 of shuffled and scrambled Sobol sequences."""
    own = pcg_hash(_u(_u(seed) + pcg_hash(pair)))
    # Scrambled like a fraction, an index goes with its whole aligned block of 2^m indices to another such block.
    x, y = sobol_plain(scrambled(index, own))
    first = scrambled(x, pcg_hash(own ^ np.uint64(0x68BC21EB)))
    second = scrambled(y, pcg_hash(own ^ np.uint64(0x02E5BE93)))
    return np.stack([first, second], axis=-1).astype(np.uint32)
