"""Planes that nothing shades, from 0 to 85 degrees; and casters that hover two texels above a plane."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from common.numerics.transforms import pose_looking_at
from common.view.camera import Orthographic, Perspective, View
from tests.support.shadows import placed, point, spot, sun, yard
from tools.exercises.checking import Given

SIZE = (48, 48)
ABOVE = View(pose_looking_at((0, 6, 0), (0, 0, 0), (0, 0, -1)), Orthographic(3.0, 0.1, 20.0))
KNOBS: dict[str, Any] = {
    "view": "shadow-factor",
    "graph": "forward",
    "shadow_sun_size": 256,
    "shadow_size": 256,
    "shadow_cascades": 1,
    "ambient": 0.0,
}


def check(given: Given) -> None:
    """First that no plane shades itself, then that the bias has not grown."""
    for kind in ("sun", "spot", "point"):
        for degrees in (20, 60, 85):
            for kernel in (1, 5):
                factors = _plane(given, kind, degrees, kernel)
                given.need(
                    (factors == 1).all(),
                    f"Under a {kind} at {degrees} degrees, with {kernel}x{kernel} texels, "
                    f"{(factors < 1).mean():.0%} of the pixels of a plane are dark, and nothing is above it.",
                )
    for degrees in (0, 45, 75):
        for kernel in (1, 5):
            height = (2 + kernel // 2) * 8.6 / 250  # texels of the ground with its guard
            factors = _hovering(given, degrees, kernel, height)
            given.need(
                (factors == 0).all(),
                f"A plate hovers {100 * height:.0f} cm above the ground, {2 + kernel // 2} texels, under a sun at "
                f"{degrees} degrees. It casts no shadow at {(factors > 0).mean():.0%} of the pixels below it.",
            )


def _plane(given: Given, kind: str, degrees: float, kernel: int) -> np.ndarray:
    """Return the factors in the middle of a ground under a light whose direction has this angle to its normal."""
    angle = math.radians(degrees)
    x, y, z = math.sin(angle) * 0.8, math.cos(angle), math.sin(angle) * 0.6
    if kind == "sun":
        light = sun((-x, -y, -z))
    elif kind == "spot":
        light = spot((4 * x, 4 * y, 4 * z), (0, 0, 0), outer=math.radians(30))
    else:
        light = point((4 * x, 4 * y, 4 * z))
    scene = yard(light)
    scene.instances.visible[1:] = False
    factors: np.ndarray = given.draw(scene, ABOVE, size=SIZE, shadow_kernel=kernel, **KNOBS)[16:32, 16:32, 0]
    return factors


def _hovering(given: Given, degrees: float, kernel: int, height: float) -> np.ndarray:
    """Return the factors of the ground below a plate, seen from between the two."""
    angle = math.radians(degrees)
    scene = yard(
        sun((-math.sin(angle), -math.cos(angle), 0.0)), extra=(placed((0, height, 0), (4, 4), (0, 1, 0)),)
    )
    scene.instances.visible[1:7] = False
    below = View(pose_looking_at((0, height / 2, 0.3), (0, 0, 0)), Perspective(0.4, 1e-3))
    factors: np.ndarray = given.draw(scene, below, size=SIZE, shadow_kernel=kernel, **KNOBS)[12:36, 12:36, 0]
    return factors
