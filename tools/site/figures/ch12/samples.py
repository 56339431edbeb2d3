"""The error of light below a square lamp by the number of paths, for ways to find the lamp."""

from __future__ import annotations

from functools import cache

import numpy as np
from numpy.typing import NDArray

from tools.site.figures.canvas import Canvas
from tools.site.figures.charts import Axis, Curve, curves

Float64 = NDArray[np.float64]

HALF, HEIGHT, BESIDE = 0.5, 0.35, 0.3
"""Half the lamp's edge, its height above the floor, and how far the point is from its middle, in metres."""
COUNTS = tuple(4**power for power in range(1, 7))
RUNS = 400
NAMES = ("reflected rays", "rays to the lamp", "both, weighted", "both, Sobol points")


def truth(nodes: int = 64) -> float:
    """Return the irradiance at the point for 1 nit, by Gauss quadrature over the lamp."""
    x, weight = np.polynomial.legendre.leggauss(nodes)
    a, b = np.meshgrid(HALF * x - BESIDE, HALF * x)
    return float((HALF**2 * np.outer(weight, weight) * HEIGHT**2 / (a * a + b * b + HEIGHT**2) ** 2).sum())


def light(towards: Float64, lamp: Float64, way: str) -> Float64:
    """Return the irradiance that paths find: `towards` and `lamp` (..., 2) draw the reflected ray and the other one."""
    sine, phi = np.sqrt(towards[..., 0]), 2.0 * np.pi * towards[..., 1]
    cosine = np.sqrt(1.0 - towards[..., 0])
    x, y = (HEIGHT * sine * turn / np.maximum(cosine, 1e-12) for turn in (np.cos(phi), np.sin(phi)))
    hit = (np.abs(x + BESIDE) < HALF) & (np.abs(y) < HALF)
    to_lamp = 2.0 * HALF * lamp - HALF
    distance2 = (to_lamp[..., 0] - BESIDE) ** 2 + to_lamp[..., 1] ** 2 + HEIGHT**2
    lamp_cosine = HEIGHT / np.sqrt(distance2)
    area = (2.0 * HALF) ** 2
    drawn = distance2 / (area * lamp_cosine)  # its density, per steradian
    if way == "reflected":
        return np.asarray(np.pi * hit, np.float64)
    if way == "lamp":
        return lamp_cosine / drawn

    def weight(own: Float64, other: Float64) -> Float64:
        return own**2 / (own**2 + other**2)

    other = (HEIGHT / np.maximum(cosine, 1e-12)) ** 2 / (area * np.maximum(cosine, 1e-12))
    by_lamp = weight(drawn, lamp_cosine / np.pi) * lamp_cosine / drawn
    return np.pi * hit * weight(cosine / np.pi, other) + by_lamp


def sobol(count: int, runs: int, rng: np.random.Generator) -> Float64:
    """Return (runs, count, 2) the first two dimensions of Sobol's sequence, each run with bits turned by lot."""
    index, bits = np.arange(count, dtype=np.uint64), 32
    points = np.zeros((count, 2), np.uint64)
    column = 1 << (bits - 1)
    for digit in range(bits):
        taken = (index >> np.uint64(digit) & np.uint64(1)).astype(bool)
        points[taken, 0] ^= np.uint64(1 << (bits - 1 - digit))
        points[taken, 1] ^= np.uint64(column)
        column ^= column >> 1  # rows of Pascal's triangle, modulo 2
    turned = points ^ rng.integers(0, 2**bits, (runs, 1, 2), np.uint64)
    return np.asarray((turned + 0.5) / 2.0**bits)


@cache
def errors() -> dict[str, list[float]]:
    """Return for each way the root of the mean squared relative error of RUNS runs, for each of COUNTS."""
    rng, exact = np.random.default_rng(12), truth()
    found: dict[str, list[float]] = {name: [] for name in NAMES}
    for count in COUNTS:
        lots = [rng.random((RUNS, count, 2)) for _ in range(2)]
        even = [
            rng.permutation(sobol(count, RUNS, rng), axis=1) if pair else sobol(count, RUNS, rng)
            for pair in range(2)
        ]
        for name, way, (a, b) in zip(
            NAMES, ("reflected", "lamp", "both", "both"), (lots, lots, lots, even), strict=True
        ):
            means = light(a, b, way).mean(axis=1)
            found[name].append(float(np.sqrt(((means / exact - 1.0) ** 2).mean())))
    return found


def error_against_samples() -> Canvas:
    """Errors of four ways on logarithmic axes."""
    return curves(
        "Error of the light below a square lamp",
        Axis("paths", log=True),
        Axis("error, of the light", log=True),
        [
            Curve(name, list(zip(map(float, COUNTS), values, strict=True)))
            for name, values in errors().items()
        ],
        f"In numpy, {RUNS} runs each; a lamp of 1 m, {100 * HEIGHT:.0f} cm above a matte floor",
    )
