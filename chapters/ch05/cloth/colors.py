"""Colours for springs: those of one colour share no particle, so that all of them can be moved at once.

XPBD moves the two particles of a spring by what it finds there, so springs with a particle in common have to come one
after the other. First fit gives each spring, in order, the lowest colour that neither of its particles has yet: at most
2 d - 1 colours where a particle has d springs, and for a grid of Provot's springs about as many as d.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray


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
