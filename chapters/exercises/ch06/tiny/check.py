"""Balls of many sizes: which of them are drawn, by the rectangle of a sphere in double precision."""

from __future__ import annotations

from typing import Any

import numpy as np

from common.numerics.transforms import pose_looking_at
from common.scene import Scene
from common.view.camera import Perspective, View
from tests.support.towns import ball, of_shapes
from tools.exercises.checking import Given

SIZE = (128, 96)
YFOV = 1.0
VIEW = View(pose_looking_at((0.0, 0.0, 0.0), (0.0, 0.0, -1.0)), Perspective(YFOV, 0.1))
COLUMNS, ROWS = 6, 4


def check(given: Given) -> None:
    """The balls that are drawn, by the picture and by the counter, in one phase and in two."""
    given.need(
        given.settings(culling_pixels=6.0).culling.pixels == 6.0, "culling_pixels is not a knob of culling."
    )
    scene, places = _scene()
    for mode, pixels in (("frustum", 12.0), ("occlusion", 6.0)):
        knobs: dict[str, Any] = {"culling": mode, "geometry": "classic", "culling_pixels": pixels}
        with given.open(scene, SIZE, ("instance_id",), **knobs) as made:
            opened: Any = made
            frame = made.render(VIEW)
            drawn = np.isin(np.arange(len(places)) + 1, frame.image("instance_id"))
            outside = frame.work["instances_outside"]
            radii = opened._data.records.instances["bounds_centre"][:, 3].astype(np.float64)
        given.silent()
        said = f"With culling={mode} and culling_pixels={pixels:g}"
        for size, there in zip(_pixels(places, radii).tolist(), drawn.tolist(), strict=True):
            given.need(
                there == (size > pixels) or abs(size - pixels) < 0.1,
                f"{said} a ball whose sphere is {size:.1f} pixels large is {'drawn' if there else 'not drawn'}.",
            )
        given.need(
            outside == int((~drawn).sum()),
            f"{said} {int((~drawn).sum())} balls are left out, and instances_outside is {outside}.",
        )


def _scene() -> tuple[Scene, np.ndarray]:
    """Return balls beside one another, of which none hides another, and their places (N, 3)."""
    y, x = np.meshgrid(np.linspace(0.6, -0.6, ROWS), np.linspace(-0.8, 0.8, COLUMNS), indexing="ij")
    distance = np.linspace(4.0, 30.0, COLUMNS * ROWS)
    half = np.tan(YFOV / 2)
    directions = np.stack([x.ravel() * half * SIZE[0] / SIZE[1], y.ravel() * half, -np.ones(x.size)], axis=-1)
    places = directions * distance[:, None]
    matrices = np.tile(np.diag([0.35, 0.35, 0.35, 1.0]), (len(places), 1, 1))
    matrices[:, :3, 3] = places
    return of_shapes([ball()], [0], np.zeros(len(places), int), matrices), places


def _pixels(places: np.ndarray, radii: np.ndarray) -> np.ndarray:
    """Return (N,) the longer side of the rectangle of each sphere, from its tangents through the eye."""
    sides = []
    for axis, (size, scale) in enumerate(((SIZE[0], SIZE[1] / SIZE[0]), (SIZE[1], 1.0))):
        angle = np.arctan2(places[:, axis], -places[:, 2])
        half = np.arcsin(radii / np.hypot(places[:, axis], places[:, 2]))
        span = np.tan(angle + half) - np.tan(angle - half)
        sides.append(span * scale / np.tan(YFOV / 2) * size / 2)
    return np.maximum(*sides)
