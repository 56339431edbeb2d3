"""What a history leaves of detail while the picture moves by half a pixel in each frame, in closed form."""

from __future__ import annotations

import math

from tools.site.figures.canvas import Canvas
from tools.site.figures.charts import Axis, Curve, curves

SHARE = 0.1
LINES = {"bilinear": (0.5, 0.5), "Catmull-Rom": (-1 / 16, 9 / 16, 9 / 16, -1 / 16)}
"""Weights of the texels around a place halfway between two of them."""


def passed(weights: tuple[float, ...], frequency: float) -> float:
    """Return by what a filter halfway between texels multiplies a pattern of so many cycles a pixel."""
    middle = (len(weights) - 1) / 2
    return sum(by * math.cos(math.tau * frequency * (n - middle)) for n, by in enumerate(weights))


def left_over(weights: tuple[float, ...], frequency: float, share: float = SHARE) -> float:
    """Return what is left of a pattern in the history, once it is the same in each frame: h = (1 - s) w h + s."""
    return share / (1 - (1 - share) * passed(weights, frequency))


def blur_of_histories() -> Canvas:
    """A curve for each filter over the frequency."""
    frequencies = [i / 100 for i in range(51)]
    found = [
        Curve(name, [(f, left_over(weights, f)) for f in frequencies], marks=False)
        for name, weights in LINES.items()
    ]
    return curves(
        "What a history leaves of detail that moves by half pixels",
        Axis("frequency, cycles a pixel"),
        Axis("part that is left"),
        found,
        "in closed form; a share of 0.1, each frame half a pixel further on; 0.25: stripes of four pixels",
    )
