"""Texels that the rule gives to lamps, against those that points in their light ask for."""

from __future__ import annotations

from typing import Any

import numpy as np

from common.numerics.transforms import pose_looking_at
from common.view.camera import Perspective, View
from tools.exercises.checking import Given

ROWS, ASPECT, YFOV = 720, 16 / 9, 1.0
PLACES = {
    "5 m before the eye, which reaches 4 m,": ((0.5, 1.0, -5.0), 4.0),
    "12 m before the eye, which reaches 3 m,": ((-2.0, 1.0, -12.0), 3.0),
    "40 m before the eye, which reaches 6 m,": ((5.0, 2.0, -40.0), 6.0),
    "above the eye, which reaches 8 m,": ((0.0, 2.0, -0.3), 8.0),
    "2 m behind the eye, which reaches 6 m,": ((0.3, 1.0, 2.0), 6.0),
}


def check(given: Given) -> None:
    """Five lamps: first that no point in their light lacks texels, then that none has far too many."""
    rule: Any = given.module("page_table.rule")
    random = np.random.default_rng(4)
    for name, (place, radius) in PLACES.items():
        found = float(rule.resolutions(_view(), ROWS, np.array([place]), np.array([radius]))[0])
        points, needed = _needed(random, np.array(place), radius, rule.NEAREST)
        most = int(needed.argmax())
        given.need(
            found >= needed[most] * (1 - 1e-6),
            f"A lamp {name} gets {found:.0f} texels along a face. A point {points[most]:.1f} m ahead, at the "
            f"edge of its reach, needs {needed[most]:.0f} for one in each pixel.",
        )
        given.need(
            found <= 1.5 * needed[most],
            f"A lamp {name} gets {found:.0f} texels along a face, and no point in its light needs more than "
            f"{needed[most]:.0f}.",
        )


def _view() -> View:
    return View(pose_looking_at((0, 0, 0), (0, 0, -1)), Perspective(YFOV, 0.05))


def _needed(
    random: np.random.Generator, place: np.ndarray, radius: float, nearest: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return how far ahead points in a lamp's light lie, and the texels along a face that each of them needs."""
    directions = random.normal(size=(200_000, 3))
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    directions[0] = (0.0, 0.0, 1.0)
    away = radius * random.uniform(0.5, 1.0, len(directions)) ** 0.1
    away[:1000] = radius
    depth = -(place + away[:, None] * directions)[:, 2]
    ahead = depth > max(0.05, nearest * radius)
    pixel = 2 * np.tan(YFOV / 2) / ROWS * depth[ahead]
    # 6 n^2 texels share 4 pi steradians; a pixel covers (pixel / away)^2 of them.
    return depth[ahead], np.sqrt(4 * np.pi / 6) * away[ahead] / pixel
