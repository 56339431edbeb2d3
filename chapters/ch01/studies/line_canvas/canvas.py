"""Lines in the world, collected anew each frame: single ones, planes, boxes, and what a camera sees."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

CAPACITY = 65_536
"""Lines that fit."""

VERTEX = np.dtype([("position", np.float32, 3), ("color", np.uint32)])
"""An end of a line, 16 bytes: metres in the world, and red, green, blue as bytes, red lowest."""

# Corners numbered by the bits zyx; an edge joins two that differ in one bit.
_EDGES = [(a, a | bit) for bit in (1, 2, 4) for a in range(8) if not a & bit]


class Canvas:
    """Collects up to `capacity` lines; `dropped` counts those that did not fit."""

    def __init__(self, capacity: int = CAPACITY) -> None:
        self._ends = np.zeros((capacity, 2), VERTEX)
        self.count = 0
        self.dropped = 0

    @property
    def ends(self) -> np.ndarray:
        """(count, 2) VERTEX: both ends of each line."""
        return self._ends[: self.count]

    def clear(self) -> None:
        """Forget all lines."""
        self.count = self.dropped = 0

    def lines(self, ends: ArrayLike, color: tuple[float, float, float]) -> None:
        """Add lines (N, 2, 3) of a colour, each channel 0 to 1 as a display's code; those over capacity are dropped."""
        ends = np.asarray(ends, np.float64).reshape(-1, 2, 3)
        fits = min(len(ends), len(self._ends) - self.count)
        added = self._ends[self.count : self.count + fits]
        added["position"] = ends[:fits]
        red, green, blue = (round(255 * min(max(c, 0.0), 1.0)) for c in color)
        added["color"] = red | green << 8 | blue << 16
        self.count += fits
        self.dropped += len(ends) - fits

    def plane(
        self,
        origin: ArrayLike,
        v1: ArrayLike,
        v2: ArrayLike,
        n1: int,
        n2: int,
        color: tuple[float, float, float],
        outline: tuple[float, float, float],
    ) -> None:
        """Add a rectangle around `origin`: 4 lines around, n1 - 1 and n2 - 1 that divide its sides `v1`, `v2`."""
        at, a, b = (np.asarray(vector, np.float64) for vector in (origin, v1, v2))
        corners = at + np.array([(-a - b) / 2, (a - b) / 2, (a + b) / 2, (b - a) / 2])
        self.lines(np.stack([corners, np.roll(corners, -1, axis=0)], axis=1), outline)
        for along, across, n in ((a, b, n1), (b, a, n2)):
            middle = at + (np.arange(1, n) / n - 0.5)[:, None] * along
            self.lines(np.stack([middle - across / 2, middle + across / 2], axis=1), color)

    def box(self, world_from_box: ArrayLike, color: tuple[float, float, float]) -> None:
        """Add the 12 edges of the cube from -1 to 1 under a (4, 4) matrix, a projective one too."""
        corners = np.array([[2 * (i >> bit & 1) - 1 for bit in range(3)] + [1] for i in range(8)], np.float64)
        self._hexahedron(corners @ np.asarray(world_from_box, np.float64).T, color)

    def frustum(self, world_from_clip: ArrayLike, far: float, color: tuple[float, float, float]) -> None:
        """Add the 12 edges of what a camera sees from its near plane to depth `far`, of 0 to 1 and never 0."""
        depths = (1.0, far)  # reversed z: 1 is near, and at 0 a perspective view's corners are infinitely far
        corners = np.array([[2 * (i & 1) - 1, 2 * (i >> 1 & 1) - 1, depths[i >> 2], 1] for i in range(8)])
        self._hexahedron(corners @ np.asarray(world_from_clip, np.float64).T, color)

    def _hexahedron(self, corners: np.ndarray, color: tuple[float, float, float]) -> None:
        points = corners[:, :3] / corners[:, 3:]
        self.lines(points[np.array(_EDGES)], color)
