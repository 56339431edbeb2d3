"""Points that fill the unit square evenly: radical inverses, the Hammersley and Halton sequences.

`shaders/sampling.glsl` has the same functions in GLSL; the ones in float32 give the same bits on every device.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

Float32 = NDArray[np.float32]
Float64 = NDArray[np.float64]

MAX_HAMMERSLEY = 2**22
"""Points of a set whose first coordinates float32 keeps apart, and below 1."""


def radical_inverse_2(index: ArrayLike) -> Float32:
    """Return the bits of 32-bit indices mirrored at the binary point, float32 in [0, 1).

    Of the 32 mirrored bits the upper 24 are kept, which are all that float32 holds: rounding the rest could give 1.0,
    and how a shader rounds an integer that does not fit is its device's choice.
    """
    bits: NDArray[np.uint32] = np.asarray(index, np.uint32)
    for step, low in ((16, 0x0000FFFF), (8, 0x00FF00FF), (4, 0x0F0F0F0F), (2, 0x33333333), (1, 0x55555555)):
        shift, mask = np.uint32(step), np.uint32(low)
        bits = ((bits & mask) << shift) | ((bits >> shift) & mask)
    return (bits >> np.uint32(8)).astype(np.float32) * np.float32(2.0**-24)


def radical_inverse(index: ArrayLike, base: int) -> Float64:
    """Return the digits of whole numbers in `base` mirrored at the point, float64 in [0, 1) (van der Corput 1935)."""
    if base < 2:
        raise ValueError(f"no number is written in base {base}")
    rest = np.array(index, np.uint64)
    # Digits are gathered as one whole number over a power of the base: a single division rounds once.
    mirrored, power = np.zeros_like(rest), np.ones_like(rest)
    while (rest > 0).any():
        going = rest > 0
        mirrored = np.where(going, mirrored * base + rest % base, mirrored)
        power = np.where(going, power * base, power)
        rest = rest // base
    return mirrored / power


def hammersley(count: int) -> Float32:
    """Return (count, 2) float32 points (i / count, radical inverse of i), each in [0, 1) (Hammersley 1960)."""
    if not 1 <= count <= MAX_HAMMERSLEY:
        raise ValueError(f"a Hammersley set has 1 to {MAX_HAMMERSLEY} points, not {count}")
    index = np.arange(count, dtype=np.uint32)
    # Multiplied, not divided: a shader's product is rounded to nearest, its quotient only nearly.
    return np.stack(
        [index.astype(np.float32) * (np.float32(1) / np.float32(count)), radical_inverse_2(index)], axis=1
    )


def halton(first: int, count: int, bases: tuple[int, ...] = (2, 3)) -> Float64:
    """Return (count, len(bases)) float64 points of the Halton sequence from index `first` on (Halton 1960)."""
    index = np.arange(first, first + count, dtype=np.uint64)
    return np.stack([radical_inverse(index, base) for base in bases], axis=1)
