"""A square in the middle of the picture, with memory poisoned before its first use: what is around it?"""

from __future__ import annotations

import numpy as np

from common.scene import Material
from tests.support.scenes import facing, quad_scene
from tools.exercises.checking import Given

GREY = 0.25
SQUARE = 0.5


def check(given: Given) -> None:
    """The background is what the settings say, whatever memory held before."""
    scene = quad_scene(Material(unlit=True), matrices=(np.diag([SQUARE, SQUARE, 1.0, 1.0]),))
    for grey in (0.0, GREY):
        for poison in ("depth 0", "depth 1", "off"):
            picture = given.draw(
                scene, facing(), size=(16, 16), graph="deferred", background=grey, poison=poison
            )
            around = picture[0, 0]
            given.need(
                np.isfinite(around).all(),
                f"With poison={poison} the background is {around[0]}: which shader reads what no pass wrote?",
            )
            given.need(
                np.allclose(around, grey, atol=1e-6),
                f"With background={grey:g} and poison={poison} the background is {around[0]:g}.",
            )
            given.need(
                np.allclose(picture[8, 8], 1.0, atol=1e-3),
                f"The square is {picture[8, 8, 0]:g} and not white any more.",
            )
