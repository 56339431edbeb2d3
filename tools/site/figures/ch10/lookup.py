"""Transmittance within slices: exact, between the ends of slices, and from where a slice begins."""

from __future__ import annotations

import math

from tools.site.figures.canvas import Canvas
from tools.site.figures.ch10.froxels import end_of
from tools.site.figures.charts import Axis, Curve, curves

EXTINCTION, NEAR, FAR, COUNT = 0.3, 1.0, 27.0, 3
SHOWN = 2
"""Slices of the drawing."""
STEPS = 40


def exact(depth: float) -> float:
    """Return the transmittance from the eye to a depth."""
    return math.exp(-EXTINCTION * depth)


def between_ends(depth: float) -> float:
    """Return what a linear filter makes of the ends of slices; w counts slices by the logarithm of the depth."""
    w = COUNT * math.log(max(depth, 1e-9) / NEAR) / math.log(FAR / NEAR)
    index = max(math.floor(w), 0)
    ends = [end_of(i, COUNT, NEAR, FAR) for i in (index - 1, index)]
    part = min(max(w - index, 0.0), 1.0)
    return (1 - part) * exact(ends[0]) + part * exact(ends[1])


def within_slice(depth: float) -> float:
    """Return the transmittance where the slice begins, times that of the rest in closed form."""
    index = next(i for i in range(COUNT) if depth <= end_of(i, COUNT, NEAR, FAR))
    begin = end_of(index - 1, COUNT, NEAR, FAR)
    return exact(begin) * math.exp(-EXTINCTION * (depth - begin))


def lookups() -> Canvas:
    """Both lookups over the depth of a surface."""
    far = end_of(SHOWN - 1, COUNT, NEAR, FAR)
    depths = [far * i / (SHOWN * STEPS) for i in range(SHOWN * STEPS + 1)]
    return curves(
        "Transmittance in front of a surface, by its depth",
        Axis("depth of the surface, m"),
        Axis("transmittance"),
        (
            Curve("exact, as by record", [(d, within_slice(d)) for d in depths], marks=False),
            Curve("between ends", [(d, between_ends(d)) for d in depths], dashed=True, marks=False),
        ),
        f"extinction {EXTINCTION:g} per metre; slices end at "
        f"{', '.join(f'{end_of(i, COUNT, NEAR, FAR):.3g} m' for i in range(COUNT))}",
    )
