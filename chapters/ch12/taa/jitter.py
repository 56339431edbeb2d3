"""Sequences of sub-pixel shifts of the picture, in pixels right and down, with a mean of zero over a period.

A renderer adds the shift of a frame to the projection (`common.layouts.fill_frame_constants`). The mean over a period
is subtracted, because a history that averages whole periods would otherwise show the picture at a shifted place: the
first four points of Halton alone have a mean of (-0.094, -0.111) pixels.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from common.numerics.sampling import radical_inverse

SEQUENCES = ("halton", "r2", "hammersley", "interleaved-gradient")

_R2 = (0.7548776662466927, 0.5698402909980532)
"""The inverse of the plastic number, the real root of x^3 = x + 1, and its square."""


def raw(sequence: str, n: ArrayLike, period: int) -> NDArray[np.float64]:
    """Return (..., 2) float64 in [0, 1): the points of indices `n` (...) of a sequence, as its source gives them.

    - halton: radical inverses of n + 1 in the bases 2 and 3 (Halton 1960). Index 0 would be the corner (0, 0).
    - r2: the fractional part of 0.5 + n * (1 / p, 1 / p^2), p the plastic number (Roberts 2018, "The unreasonable
      effectiveness of quasirandom sequences").
    - hammersley: (n / period, radical inverse of n in base 2) (Hammersley 1960). It alone needs the period.
    - interleaved-gradient: f(n, 0) and f(0, n), where f(x, y) is the fractional part of 52.9829189 times the
      fractional part of 0.06711056 x + 0.00583715 y (Jimenez 2014, "Next generation post processing in Call of Duty").

    Raises ValueError for a name that is not in SEQUENCES and for a period below 1.
    """
    if sequence not in SEQUENCES:
        raise ValueError(f"{sequence!r} is no sequence; there are {', '.join(SEQUENCES)}")
    if period < 1:
        raise ValueError(f"a period has at least one frame, not {period}")
    index = np.asarray(n, np.int64)
    if sequence == "halton":
        return np.stack([radical_inverse(index + 1, base) for base in (2, 3)], axis=-1)
    if sequence == "r2":
        return (0.5 + index[..., None] * np.array(_R2)) % 1.0
    if sequence == "hammersley":
        return np.stack([index / period, radical_inverse(index, 2)], axis=-1)
    return (52.9829189 * (index[..., None] * np.array((0.06711056, 0.00583715)) % 1.0)) % 1.0


@lru_cache(16)
def offsets(sequence: str, period: int) -> NDArray[np.float64]:
    """Return (period, 2) float64, not to be written: the shifts of one period in pixels, right and down.

    These are the raw points minus their mean, so their mean is zero within 1e-16. A point x of [0, 1) with the mean m
    becomes x - m, which lies in (-1, 1) for every sequence and period, and in (-0.5, 0.5) only if the mean is near
    one half. Nothing is scaled to stay below one half: a sample half a pixel away from its pixel's centre is no
    limit for a reconstruction filter, and scaling would change the distances between samples. A period of 1 gives
    (0, 0).
    """
    points = raw(sequence, np.arange(period), period)
    for _ in range(2):  # the first mean is rounded, and the second one is of what the first left
        points = points - points.mean(axis=0)
    points.flags.writeable = False
    return points


def offset(sequence: str, period: int, frame_index: int) -> tuple[float, float]:
    """Return the shift of one frame in pixels, right and down; frames wrap at the period."""
    right, down = _pairs(sequence, period)[frame_index % period]
    return right, down


@lru_cache(16)
def _pairs(sequence: str, period: int) -> tuple[tuple[float, float], ...]:
    return tuple((float(right), float(down)) for right, down in offsets(sequence, period))
