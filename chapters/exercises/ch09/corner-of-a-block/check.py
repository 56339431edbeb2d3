"""Blocks of a picture whose sides are no multiples of them, against the pixels of a frame at full rate."""

from __future__ import annotations

from typing import Any

import numpy as np

from common.numerics.transforms import pose_looking_at
from common.view.camera import Perspective, View
from tests.support.shadows import point, spot, yard
from tools.exercises.checking import Given

SIZE = (70, 45)
VIEW = View(pose_looking_at((3.0, 2.5, 4.0), (0.0, 0.4, 0.0)), Perspective(0.9, 0.05))
KNOBS: dict[str, Any] = {
    "graph": "compute",
    "gbuffer_format": "full",
    "anisotropy": 1.0,
    "ambient": 0.0,
    "shadows": "off",
}


def check(given: Given) -> None:
    """Blocks of 2x2 and 4x4: first those inside of the picture, then those over its edge."""
    scene = yard(spot((1.5, 4.0, 1.0), (0.0, 0.5, 0.0)), point((-1.2, 3.0, 0.8)))
    whole = given.draw(scene, VIEW, size=SIZE, rate_policy="none", **KNOBS)
    x, y = np.meshgrid(np.arange(SIZE[0]), np.arange(SIZE[1]))
    for side in (2, 4):
        blocks = given.draw(
            scene,
            VIEW,
            size=SIZE,
            rate_policy="radial",
            rate_radius=0.0,
            rate_coarse=f"{side}x{side}",
            **KNOBS,
        )
        first = [at // side * side for at in (x, y)]
        centre = [at + side // 2 for at in first]
        over = (centre[0] >= SIZE[0]) | (centre[1] >= SIZE[1])
        column, row = (np.minimum(at, most - 1) for at, most in zip(centre, SIZE, strict=True))
        wrong = (blocks != whole[row, column]).any(axis=-1)
        for where, here in (("inside of the picture", ~over), ("over the edge of the picture", over)):
            for top, left in np.argwhere(wrong & here)[:1].tolist():
                given.need(
                    False,
                    f"The block of {side}x{side} pixels at ({first[0][top, left]}, {first[1][top, left]}), {where}, is "
                    f"to have the light of pixel ({column[top, left]}, {row[top, left]}), and has another one.",
                )
