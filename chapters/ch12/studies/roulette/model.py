"""The room of the study, and what roulette costs and saves in it: variance, time and efficiency. No device."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from common.scene import Material, Scene
from common.view.camera import View

from ..of_paths import Square, square_at, squares

STARTS = {"from the first reflection": 0, "after three": 3, "never": 1024}
"""Values of `path_roulette`, by what they mean."""


WHITE, RED, GREEN = (0.8, 0.8, 0.8), (0.75, 0.12, 0.1), (0.15, 0.6, 0.2)


def room() -> Scene:
    """Return a closed room of 2 x 2 x 4 metres with a block and a lamp, in which light is reflected many times."""

    def wall(center: tuple[float, float, float], normal: tuple[float, float, float], color: Any) -> Square:
        paint = Material("wall", (*color, 1.0), 0.0, 1.0)
        return square_at(center, normal, (2.0 if normal[0] or normal[1] else 1.0, 1.0)), paint

    def lying(
        y: float, normal: tuple[float, float, float], half: tuple[float, float], paint: Material
    ) -> Square:
        return square_at((0.0, y, 0.0), normal, half), paint

    white = Material("wall", (*WHITE, 1.0), 0.0, 1.0)
    lamp = Material("lamp", (0.0, 0.0, 0.0, 1.0), 1.0, 1.0, emissive=(10.0, 9.0, 7.0))
    placed = [
        lying(0.0, (0.0, 1.0, 0.0), (2.0, 2.0), white),
        lying(2.0, (0.0, -1.0, 0.0), (2.0, 2.0), white),
        lying(1.99, (0.0, -1.0, 0.0), (0.5, 0.5), lamp),
        wall((-1.0, 1.0, 0.0), (1.0, 0.0, 0.0), RED),
        wall((1.0, 1.0, 0.0), (-1.0, 0.0, 0.0), GREEN),
        wall((0.0, 1.0, -2.0), (0.0, 0.0, 1.0), WHITE),
        wall((0.0, 1.0, 2.0), (0.0, 0.0, -1.0), WHITE),
    ]
    for normal in ((1.0, 0.0, 0.0), (-1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)):
        center = tuple(at + 0.3 * along for at, along in zip((0.3, 0.3, -0.8), normal, strict=True))
        placed.append((square_at(center, normal, (0.3, 0.3)), white))
    return squares("room", placed, (0.0, 1.0, 1.9), (0.0, 0.95, -2.0), math.radians(55.0), 1.0)


@dataclass(frozen=True, eq=False)
class Measured:
    """Paths that end by one rule."""

    pictures: NDArray[np.float64]
    """(N, H, W, 3) the light of one path a pixel, in each of N frames."""
    milliseconds: float
    """The time of a frame on the GPU, the median."""

    @property
    def variance(self) -> float:
        """The variance of a path's luminance from frame to frame, the mean over pixels, relative to the mean light."""
        green = self.pictures[..., 1]
        return float(green.var(axis=0, ddof=1).mean() / green.mean() ** 2)

    @property
    def efficiency(self) -> float:
        """One over variance and time, in 1 / ms."""
        return 1.0 / (self.variance * self.milliseconds)


def measured(renderer: Any, view: View, start: int, frames: int) -> Measured:
    """Return what frames of a renderer show and take whose paths may end behind `start` reflections.

    The renderer has the output "color_linear". Sums of frames are off meanwhile.
    """
    knobs = renderer.settings.paths
    before = knobs.path_roulette, knobs.path_average, knobs.path_seed
    knobs.path_roulette, knobs.path_average, knobs.path_seed = start, False, start
    pictures, times = [], []
    try:
        for _ in range(frames):
            frame = renderer.render(view, 0.0)
            pictures.append(np.asarray(frame.image("color_linear"), np.float64))
            times.append(frame.timings.get("paths", 0.0))
    finally:
        knobs.path_roulette, knobs.path_average, knobs.path_seed = before
    return Measured(np.stack(pictures), float(np.median(times)))
