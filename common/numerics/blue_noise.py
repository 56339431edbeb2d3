"""Blue noise: a table of ranks, numbers from it that change from frame to frame, and their triangular sum.

`assets/blue_noise.py` makes the table, `shaders/blue_noise.glsl` has the same functions in GLSL. All of it is
arithmetic of whole numbers until the last step, so that both give the same bits on every device.
"""

from __future__ import annotations

from functools import cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from common.images.images import read_image
from common.paths import ROOT

Float32 = NDArray[np.float32]

TABLE = ROOT / "assets" / "tables" / "blue_noise.png"
SIZE = 128
"""Texels a side of the table."""

FRAMES = 256
"""Frames after which the numbers repeat."""

GOLDEN = 0x9E3779B9
"""The golden ratio's fractional part times 2^32, to the nearest whole number."""


@cache
def ranks() -> NDArray[np.uint16]:
    """Return the table (SIZE, SIZE, 2) uint16: each channel has every rank from 0 to SIZE^2 - 1 once."""
    table = read_image(TABLE).astype(np.uint16)
    table.flags.writeable = False
    return table


def animated(rank: ArrayLike, frame: ArrayLike) -> Float32:
    """Return the number in [0, 1) of a rank in a frame, float32: (rank + 1/2) / SIZE^2 + frame * golden, wrapped.

    Multiples of the golden ratio fill the interval evenly, whatever their number: 256 of them leave gaps of 0.0050 at
    most. One frame's numbers are those of the table, turned; so each frame is as blue.
    """
    turn = (np.asarray(frame, np.uint32) % np.uint32(FRAMES)).astype(np.uint64) * np.uint64(GOLDEN)
    start = (np.asarray(rank, np.uint64) * np.uint64(2) + np.uint64(1)) << np.uint64(17)
    bits = (start + turn) & np.uint64(0xFFFFFFFF)
    # The upper 24 bits are all that float32 holds; rounding the others could give 1.0.
    return (bits >> np.uint64(8)).astype(np.float32) * np.float32(2.0**-24)


def triangular(first: ArrayLike, second: ArrayLike) -> Float32:
    """Return the sum of two numbers less 1, in [-1, 1): the density is a triangle, its mean 0, its variance 1/6."""
    return np.asarray(first, np.float32) + np.asarray(second, np.float32) - np.float32(1.0)
