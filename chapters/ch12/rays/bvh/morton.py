"""Morton order (Morton 1966): the bits of x, y and z by turns, so that what is near in space is near in the list."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

BITS = 21
"""Of each axis: three of them fill 63 bits."""


def spread(values: NDArray[np.uint64]) -> NDArray[np.uint64]:
    """Return `values` below 2^21 with two zero bits behind each of their bits."""
    spread = values & np.uint64(0x1FFFFF)
    for shift, mask in (
        (32, 0x1F00000000FFFF),
        (16, 0x1F0000FF0000FF),
        (8, 0x100F00F00F00F00F),
        (4, 0x10C30C30C30C30C3),
        (2, 0x1249249249249249),
    ):
        spread = (spread | spread << np.uint64(shift)) & np.uint64(mask)
    return spread


def codes(points: NDArray[np.float32], bits: int = BITS) -> NDArray[np.uint64]:
    """Return the Morton codes of (N, 3) points within their common box, `bits` of each axis; x has the highest bit.

    What is not finite counts as the box's low corner. A box without extent along an axis gives that axis zeros.
    """
    places = np.asarray(points, np.float64)
    finite = np.asarray(np.isfinite(places).all(axis=1))
    if not finite.any():
        return np.zeros(len(places), np.uint64)
    low, high = places[finite].min(axis=0), places[finite].max(axis=0)
    size = np.where(high > low, high - low, 1.0)
    places = np.where(finite[:, None], (places - low) / size, 0.0) * (2.0**bits)
    cells = np.minimum(places, 2.0**bits - 1).astype(np.uint64)
    x, y, z = (spread(cells[:, axis]) for axis in range(3))
    return x << np.uint64(2) | y << np.uint64(1) | z


def order(points: NDArray[np.float32]) -> NDArray[np.int64]:
    """Return the order of (N, 3) points along the curve; equal ones keep their order."""
    return np.argsort(codes(points), kind="stable")
