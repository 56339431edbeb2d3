"""Optical depths of segments, against sums over many points."""

from __future__ import annotations

from typing import Any

import numpy as np

from common.environment.medium import FogBox, Medium
from tools.exercises.checking import Given

POINTS = 20_000
BOXES = (FogBox((1.0, 0.8, 1.5), (0.8, 0.7, 0.9), 0.6), FogBox((0.5, 1.0, 1.0), (0.4, 2.0, 0.3), 0.25))
MEDIA = {
    "constant fog": Medium(extinction=0.05),
    "height fog": Medium(height_extinction=0.3, height_falloff=1.5, height_base=0.2),
    "height fog that does not thin out": Medium(height_extinction=0.3, height_base=0.2),
    "two boxes": Medium(boxes=BOXES),
    "all of them": Medium(0.02, 0.3, 0.5, 0.1, boxes=BOXES),
}
SEGMENTS = {
    "upwards through the base": ((0.5, -1.0, 1.0), (0.8, 3.0, 1.2)),
    "downwards": ((0.8, 3.0, 1.2), (0.5, -1.0, 1.0)),
    "below the base": ((0.0, -2.0, 0.0), (1.0, -0.5, 2.0)),
    "level, above the base": ((-3.0, 0.9, 1.4), (4.0, 0.9, 1.4)),
    "nearly level": ((-3.0, 0.9, 1.4), (4.0, 0.9 + 1e-9, 1.4)),
    "past the boxes": ((3.0, 0.5, 3.0), (3.0, 4.0, -2.0)),
    "that ends in a box": ((5.0, 2.0, 4.0), (1.0, 0.9, 1.3)),
    "of no length": ((1.0, 0.8, 1.5), (1.0, 0.8, 1.5)),
}


def check(given: Given) -> None:
    """Five media on eight segments."""
    function: Any = getattr(given.module("fog.ways"), "optical_depth", None)
    given.need(callable(function), "fog/ways.py has no function optical_depth yet.")
    for medium_name, medium in MEDIA.items():
        for segment, (start, end) in SEGMENTS.items():
            with np.errstate(all="ignore"):
                found = float(function(np.array(start), np.array(end), medium))
            wanted = _sum(np.array(start), np.array(end), medium)
            given.need(
                abs(found - wanted) <= 2e-3 * max(wanted, 0.01),
                f"On a segment {segment} the optical depth of {medium_name} is {wanted:.5f}, and the result is "
                f"{found:.5f}.",
            )


def _sum(start: np.ndarray, end: np.ndarray, medium: Medium) -> float:
    """Return the optical depth of a segment, by the middles of many parts of it."""
    points = start + (np.arange(POINTS)[:, None] + 0.5) / POINTS * (end - start)
    above = np.maximum(points[:, 1] - medium.height_base, 0.0)
    extinction = medium.extinction + medium.height_extinction * np.exp(-medium.height_falloff * above)
    for box in medium.boxes:
        extinction += box.extinction * (np.abs(points - box.center) <= box.half_size).all(axis=1)
    return float(extinction.mean() * np.linalg.norm(end - start))
