"""The light of a slab in 32 bits: errors of the quotient and of the series."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tools.site.figures.canvas import Canvas
from tools.site.figures.charts import Axis, Curve, curves

SWITCH, TERMS = 0.5, 8
"""Of shaders/medium.glsl: where the series ends, and its last divisor."""
LEAST = 1e-8
"""Errors below are shown there."""

Float32 = NDArray[np.float32]


def quotient(x: Float32) -> Float32:
    """Return (1 - exp(-x)) / x as it is written, in 32 bits."""
    result: Float32 = (np.float32(1) - np.exp(-x)) / x
    return result


def series(x: Float32) -> Float32:
    """Return the same by a series below SWITCH, in 32 bits."""
    total = np.ones_like(x)
    for divisor in range(TERMS, 1, -1):
        total = np.float32(1) - x / np.float32(divisor) * total
    return np.where(x < SWITCH, total, quotient(x))


def largest_errors() -> tuple[list[float], list[float], list[float]]:
    """Return optical depths, and the largest relative errors of both forms around each of them."""
    depths = np.logspace(-9, 1, 41)
    near = (depths[:, None] * np.linspace(0.9, 1.1, 401)).astype(np.float32)
    exact = -np.expm1(-near.astype(np.float64)) / near
    first, second = (
        np.maximum(np.abs(form(near) / exact - 1).max(axis=1), LEAST).tolist() for form in (quotient, series)
    )
    return depths.tolist(), first, second


def errors_of_a_slab() -> Canvas:
    """Two curves over the optical depth of a slice."""
    depths, first, second = largest_errors()
    return curves(
        "The light of a slab by the usual quotient and by a series, over its optical depth",
        Axis("optical depth of a slice", log=True),
        Axis("largest relative error", log=True),
        (
            Curve("(1 - exp(-x)) / x", [*zip(depths, first, strict=True)], marks=False),
            Curve("series below 0.5", [*zip(depths, second, strict=True)], marks=False),
        ),
        "in 32 bits, by numpy; an error of 1 is all of the light",
    )
