"""A wall and cubes, seen from the ground and from above: what each frame draws, and in which phase."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from common.numerics.transforms import pose_looking_at
from common.scene import Scene
from common.view.camera import Perspective, View
from tests.support.towns import cube, of_shapes
from tools.exercises import Answer
from tools.exercises.checking import Given

SIZE = (96, 64)
GROUND = View(pose_looking_at((0.0, 0.0, 6.0), (0.0, 0.0, 0.0)), Perspective(1.0, 0.1))
ABOVE = View(pose_looking_at((0.0, 5.0, 5.0), (0.0, 0.0, -1.0)), Perspective(1.0, 0.1))


def measure(given: Given) -> dict[str, Answer]:
    """Draw the frames of the task, and frame 2 without culling."""
    views = [GROUND, GROUND, ABOVE, ABOVE, GROUND, GROUND, replace(GROUND, cut=True)]
    drawn, late, pictures = [], [], []
    with given.open(
        _scene(), SIZE, ("instance_id",), culling="occlusion", geometry="classic", ambient=0.5
    ) as renderer:
        for view in views:
            frame = renderer.render(view)
            pictures.append(frame.image("instance_id").copy())
            drawn.append(frame.work["units_drawn"])
            late.append(frame.work["units_late"])
    whole = given.draw(_scene(), ABOVE, "instance_id", SIZE, culling="off", ambient=0.5)
    given.silent()
    return {
        "first_drawn": drawn[0],
        "first_late": late[0],
        "second_drawn": drawn[1],
        "above_late": late[2],
        "still_late": late[3],
        "back_drawn": drawn[4],
        "after_drawn": drawn[5],
        "cut_drawn": drawn[6],
        "lost": int((pictures[2] != whole).sum()),
    }


def _scene() -> Scene:
    places = [(0.0, 0.0, 0.0)]
    places += [(0.3 * x - 0.6, 0.4 * y - 0.2, -2.0) for y in range(2) for x in range(5)]
    places += [(x, 0.0, -1.0) for x in (-2.4, -1.9, 1.9, 2.4)]
    places += [(0.5 * x, 0.0, 9.0) for x in range(5)]
    matrices = np.tile(np.diag([0.1, 0.1, 0.1, 1.0]), (len(places), 1, 1))
    matrices[0] = np.diag([1.4, 1.0, 0.1, 1.0])
    matrices[:, :3, 3] = places
    return of_shapes([cube()], [0], np.zeros(len(places), int), matrices)
