"""A lamp and six screens around it: each has the shadow of a small square in its middle."""

from __future__ import annotations

import numpy as np

from common.numerics.transforms import pose_looking_at
from common.view.camera import Orthographic, View
from tests.support.shadows import placed, point, yard
from tools.exercises.checking import Given

SIZE = (24, 24)
HALF = 1.5
"""Half of what a picture shows of a screen, in metres."""
SIDES = {
    "+x": (1, 0, 0),
    "-x": (-1, 0, 0),
    "+y": (0, 1, 0),
    "-y": (0, -1, 0),
    "+z": (0, 0, 1),
    "-z": (0, 0, -1),
}


def check(given: Given) -> None:
    """One side after the other, with a kernel of one texel."""
    at = (np.arange(SIZE[0]) + 0.5) / SIZE[0] * 2 * HALF - HALF
    middle = np.maximum(abs(at[:, None]), abs(at[None, :]))
    for name, side in SIDES.items():
        factors = _screen(given, np.array(side, np.float64))
        dark, lit = middle < 0.5, middle > 0.7
        given.need(
            (factors[dark] == 0).all(),
            f"The screen on the side {name} of the lamp has the shadow of a square in its middle: "
            f"{(factors[dark] > 0).sum()} of {dark.sum()} pixels of it are lit.",
        )
        given.need(
            (factors[lit] == 1).all(),
            f"Around the shadow on the side {name} of the lamp {(factors[lit] < 1).sum()} of {lit.sum()} pixels are "
            "dark.",
        )


def _screen(given: Given, side: np.ndarray) -> np.ndarray:
    """Return (H, W) the part of the light that reaches a screen 3 m from the lamp, behind a square of 0.6 m."""
    scene = yard(
        point((0.0, 5.0, 0.0)),
        extra=(_square(3.0 * side, 6.0, side), _square(1.5 * side, 0.6, side)),
    )
    scene.instances.visible[:7] = False
    eye, up = np.array((0.0, 5.0, 0.0)) + 2.0 * side, (0, 1, 0) if side[1] == 0 else (0, 0, 1)
    view = View(pose_looking_at(eye, eye + side, up), Orthographic(HALF, 0.1, 2.0))
    picture = given.draw(
        scene, view, size=SIZE, view="shadow-factor", graph="forward", shadow_kernel=1, ambient=0.0
    )
    factors: np.ndarray = picture[..., 0]
    return factors


def _square(at: np.ndarray, edge: float, side: np.ndarray) -> np.ndarray:
    """Return the matrix of a square around a place beside the lamp, which faces the lamp."""
    x, y, z = (at + np.array((0.0, 5.0, 0.0))).tolist()
    nx, ny, nz = (-side).tolist()
    return placed((x, y, z), (edge, edge), (nx, ny, nz))
