"""Frames that stand still have nothing late; what comes to be hidden is not drawn any more."""

from __future__ import annotations

import numpy as np

from common.numerics.transforms import pose_looking_at
from common.scene import Scene
from common.view.camera import Perspective, View
from tests.support.towns import ball, cube, of_shapes
from tools.exercises.checking import Given

SIZE = (96, 64)
GROUND = View(pose_looking_at((0.0, 0.0, 6.0), (0.0, 0.0, 0.0)), Perspective(1.0, 0.1))
ABOVE = View(pose_looking_at((0.0, 5.0, 5.0), (0.0, 0.0, -1.0)), Perspective(1.0, 0.1))
BALLS = 6


def check(given: Given) -> None:
    """Three frames from the ground, where a wall hides balls; three from above; and three from the ground again."""
    drawn, late = [], []
    with given.open(_scene(), SIZE, culling="occlusion", geometry="compute") as renderer:
        for view in [GROUND] * 3 + [ABOVE] * 3 + [GROUND] * 3:
            work = renderer.render(view).work
            drawn.append(work["units_drawn"])
            late.append(work["units_late"])
    given.silent()
    for frame in (1, 2, 4, 5, 7, 8):
        given.need(
            late[frame] == 0,
            f"Frame {frame} of a view that stands still draws {late[frame]} of {drawn[frame]} units late.",
        )
    given.need(
        drawn[8] == drawn[2] < drawn[5],
        f"From the ground {drawn[2]} units are drawn, from above {drawn[5]}, and from the ground again {drawn[8]}: is "
        "what is hidden written down?",
    )


def _scene() -> Scene:
    """A wall with small balls behind it, and a large ball of which it hides the lower part."""
    matrices = np.tile(np.diag([0.2, 0.2, 0.2, 1.0]), (BALLS + 2, 1, 1))
    matrices[0] = np.diag([1.6, 1.0, 0.1, 1.0])
    matrices[1] = np.diag([0.9, 0.9, 0.9, 1.0])
    places = [(0.0, 0.0, 0.0), (0.0, 1.2, -3.0), *((0.45 * x - 1.1, 0.0, -1.5) for x in range(BALLS))]
    matrices[:, :3, 3] = places
    mesh = np.array([0, 2] + [1] * BALLS)
    return of_shapes([cube(), ball(), ball(32, 48)], [0, 0, 0], mesh, matrices)
