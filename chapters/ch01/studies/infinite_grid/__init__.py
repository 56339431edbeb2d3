"""Study: a plane without an end, ruled in squares that grow with the distance. A picture from rays, without a mesh."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from common.lessons import Study
from common.settings import knob
from common.view.camera import View

from ..drawing import Drawn

STUDY = Study(
    title="infinite grid",
    idea="A pixel that knows how large its footprint is can choose how fine to draw, and nothing flickers.",
    order=31,
    features=("debug-draw/infinite-grid",),
)


@dataclass(frozen=True)
class Settings:
    """The knobs of this study."""

    height: float = knob(-0.6, "of the plane in the world", unit="m")
    cell: float = knob(0.025, "side of the smallest square", unit="m", minimum=1e-4, maximum=10.0)
    least: float = knob(2.0, "pixels between lines, at least", unit="px", minimum=1.0, maximum=50.0)
    radius: float = knob(100.0, "distance from below the camera at which the grid has faded", minimum=0.1)


LEVELS = 6
"""Sizes of squares: `cell` times 1, 10, ... 100,000."""

UNIFORM_BYTES = (7 + LEVELS) * 16

DRAWN = Drawn(("plane.vert", "plane.frag"), depth=False)


def uniforms(settings: Settings, view: View, size: tuple[int, int]) -> np.ndarray:
    """Return what the shaders read, (52,) float32: rays, relative to the eye, and where in each level's square it is.

    A ray begins at `start + x start_x + y start_y` and goes along the same of `ray`; x and y are in pixels.
    """
    width, height = size
    view_from_clip = np.linalg.inv(view.clip_from_view(width / height))
    rotation, perspective = (
        view.world_from_view[:3, :3],
        view_from_clip[2, 3] != 0 and view_from_clip[3, 2] != 0,
    )
    # Two points on the line through a pixel, for the corner of the picture and one pixel to the right and below.
    corner, across, down = (
        np.array((x, y, 1.0, 1.0)) for x, y in ((-1, -1), (-1 + 2 / width, -1), (-1, -1 + 2 / height))
    )
    near = []
    for point in (corner, across, down):
        seen = view_from_clip @ point
        near.append(rotation @ (seen[:3] / seen[3]))
    if perspective:  # from the eye through the point on the near plane
        start, ray = np.zeros((3, 3)), np.array(near)
    else:
        start, ray = np.array(near), np.tile(-rotation[:, 2], (3, 1))
    start[1:] -= start[0]
    ray[1:] -= ray[0]
    rows = np.zeros((7 + LEVELS, 4))
    rows[:3, :3], rows[3:6, :3] = start, ray
    rows[6] = view.eye[1] - settings.height, settings.cell, settings.least, settings.radius
    # In double precision: far from home, where a float cannot tell one square from the next, lines stay where they are.
    squares = settings.cell * 10.0 ** np.arange(LEVELS)
    rows[7:, 0], rows[7:, 1] = view.eye[0] % squares, view.eye[2] % squares
    return rows.astype(np.float32).ravel()
