"""A square moves above a ground, in steps: the picture against that of a renderer that is opened after them."""

from __future__ import annotations

from typing import Any

import numpy as np

from common.numerics.transforms import pose_looking_at
from common.scene import Scene
from common.view.camera import Orthographic, View
from tests.support.shadows import placed, point, sun, yard
from tools.exercises.checking import Given

SIZE = (48, 48)
VIEW = View(pose_looking_at((0, 6, 0), (0, 0, 0), (0, 0, -1)), Orthographic(3.0, 0.1, 20.0))
STEP = np.array((0.5, 0.0, 0.2))
STEPS = 2
FRAMES = 8
"""Frames until shadows come to rest, at most."""


KNOBS: dict[str, Any] = {
    "view": "shadow-factor",
    "graph": "forward",
    "shadow_sun_size": 256,
    "shadow_size": 128,
    "shadow_detail": 16.0,
    "shadow_cascades": 1,
    "ambient": 0.0,
}


def check(given: Given) -> None:
    """Some steps. What is shown has to be the shadow of the scene as it is."""
    scene = _scene()
    with given.open(scene, SIZE, ("color_linear",), **KNOBS) as renderer:
        _factors(renderer)
        for _ in range(STEPS):
            _move(scene, STEP)
            factors = _factors(renderer)
    given.silent()
    scene = _scene()
    _move(scene, STEPS * STEP)
    wanted = given.draw(scene, VIEW, size=SIZE, shadow_memory="full", **KNOBS)[..., 0]
    darker, lighter = int((factors < wanted).sum()), int((factors > wanted).sum())
    given.need(
        darker == 0,
        f"After {STEPS} steps of a square {darker} pixels are darker than in a renderer that was opened after them: "
        "a shadow is where nothing is any more.",
    )
    given.need(
        lighter == 0,
        f"After {STEPS} steps of a square {lighter} pixels are lighter than in a renderer that was opened after them: "
        "a shadow is missing.",
    )


def _scene() -> Scene:
    """Return the yard under a sun and a lamp, with a square that is going to move above it."""
    return yard(
        sun((0.3, -1.0, 0.2)),
        point((-1.2, 3.0, 0.8)),
        extra=(placed((-1.6, 0.8, 1.2), (0.7, 0.7), (0, 1, 0)),),
    )


def _move(scene: Scene, by: np.ndarray) -> None:
    """Move the square: it is behind the ground and the six sides of the cube."""
    matrix = scene.nodes.matrix[7].copy()
    matrix[:3, 3] += by
    with scene.edit() as edit:
        edit.set_transform(7, matrix=matrix)


def _factors(renderer: Any) -> np.ndarray:
    """Return (H, W) the part of the light that arrives, once no tile waits any more."""
    for _ in range(FRAMES):
        frame = renderer.render(VIEW)
    factors: np.ndarray = frame.image("color_linear")[..., 0].copy()
    return factors
