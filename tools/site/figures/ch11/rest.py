"""A pixel that an edge crosses, over frames: an exponential average goes around, and a mean over periods stops."""

from __future__ import annotations

import numpy as np

from chapters.ch11.taa.jitter import offsets
from chapters.ch11.taa.model import Shares
from tools.site.figures.canvas import Canvas
from tools.site.figures.charts import Axis, Curve, curves

PERIOD, FRAMES, SHARE = 8, 48, 0.1
NORMAL, COVERED = (0.8, 0.6), 0.37
"""The direction of the edge, and the part of the eight samples' range that it covers."""


def samples() -> list[float]:
    """Return what the frames of a period show: 1 where the sample is covered by the edge, 0 elsewhere."""
    along = offsets("halton", PERIOD) @ np.array(NORMAL)
    return [float(at < np.quantile(along, COVERED)) for at in along]


def histories() -> tuple[list[float], list[float]]:
    """Return the history after each frame: an exponential average, and as the chapter averages equal frames."""
    shown, shares = samples(), Shares(SHARE, PERIOD, True)
    plain, kept = [shown[0]], [shown[0]]
    shares.next(True, False)
    for frame in range(1, FRAMES):
        now = shown[frame % PERIOD]
        plain.append(plain[-1] + SHARE * (now - plain[-1]))
        kept.append(kept[-1] + shares.next(True, True) * (now - kept[-1]))
    return plain, kept


def pixel_at_an_edge() -> Canvas:
    """Both histories, and the mean of the period."""
    plain, kept = histories()
    mean = sum(samples()) / PERIOD
    frames = range(1, FRAMES + 1)
    return curves(
        "A pixel at an edge over frames: two histories",
        Axis("frame"),
        Axis("history of the pixel"),
        (
            Curve("a tenth of each frame", [*zip(map(float, frames), plain, strict=True)], marks=False),
            Curve("the mean, at rest", [*zip(map(float, frames), kept, strict=True)], marks=False),
            Curve("mean of the period", [(1.0, mean), (float(FRAMES), mean)], dashed=True, marks=False),
        ),
        f"{PERIOD} shifts of Halton, {sum(samples()):g} of them covered; after four periods nothing changes",
    )
