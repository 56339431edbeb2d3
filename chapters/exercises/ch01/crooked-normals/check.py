"""The normal of a stretched, leaning square is perpendicular to two of its edges in the world."""

from __future__ import annotations

import numpy as np

from common.numerics.transforms import rotation
from common.scene import Material
from tests.support.scenes import facing, quad_scene
from tools.exercises.checking import Given


def check(given: Given) -> None:
    """Compare with a cross product, for a turn alone and for a turn that is stretched."""
    lean = rotation((0, 1, 0), 0.6)
    for stretch, what in (((1, 1, 1), "only turned"), ((3, 1, 1), "turned and then stretched along x")):
        matrix = np.diag([*stretch, 1.0]) @ lean
        x, y = matrix[:3, 0], matrix[:3, 1]  # where the square's edges point in the world
        wanted = np.cross(x, y) / np.linalg.norm(np.cross(x, y))
        codes = given.draw(
            quad_scene(Material(), matrices=(matrix,)), facing(), "color", (8, 8), view="normal"
        )
        seen = codes[4, 4] / 255.0 * 2.0 - 1.0
        off = np.degrees(np.arccos(np.clip(seen @ wanted / np.linalg.norm(seen), -1, 1)))
        given.need(off < 1.0, f"A square that is {what} has a normal that is {off:.0f} degrees off.")
