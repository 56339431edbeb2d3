"""Motion of a wall before a camera that is moved sideways, by hand."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from common.scene import Material
from common.view.camera import Perspective, View
from tests.support.scenes import facing, quad_scene, translated
from tools.exercises.checking import Given

SIZE, DISTANCE, FIELD = (32, 24), 2.0, 0.9
STEPS = {
    "to the right": (0.05, 0.0),
    "upwards": (0.0, 0.04),
    "to the left and down": (-0.03, -0.02),
    "nowhere": (0, 0),
}


def check(given: Given) -> None:
    """The camera moves by (x, y) metres: the wall moves by that over what the picture shows of it, the other way."""
    wall = quad_scene(Material(double_sided=True), matrices=(np.diag([20.0, 20.0, 1.0, 1.0]),))
    begin: View = replace(facing(DISTANCE), projection=Perspective(FIELD, 0.05))
    tall = 2 * DISTANCE * math.tan(FIELD / 2)
    wide = tall * SIZE[0] / SIZE[1]
    for way, (x, y) in STEPS.items():
        end = replace(begin, world_from_view=begin.world_from_view @ translated(x, y))
        with given.open(wall, SIZE, ("motion",)) as renderer:
            renderer.render(begin)
            found = renderer.render(end).image("motion")
        given.silent()
        wanted = np.array((-x / wide, y / tall))
        middle = found[SIZE[1] // 2, SIZE[0] // 2]
        given.need(
            np.abs(found - wanted).max() <= 1e-3 * np.abs(wanted).max(),
            f"The camera moves {way}, so the wall moves by ({wanted[0]:.4f}, {wanted[1]:.4f}) of the picture, and "
            f"the vector is ({middle[0]:.4f}, {middle[1]:.4f}).",
        )
