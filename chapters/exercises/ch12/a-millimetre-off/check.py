"""A plate that casts a shadow, at two sizes: the pictures are the same."""

from __future__ import annotations

import numpy as np

from common.numerics.transforms import pose_looking_at, rotation
from common.scene import Light, Material, Scene
from common.view.camera import Orthographic, View
from tests.support.scenes import quad_scene, translated
from tools.exercises.checking import Given

SIZES = {"of metres": 1.0, "of millimetres": 1e-3}


def check(given: Given) -> None:
    """The share of pixels in shadow, and the pictures, of scenes that differ in their size alone."""
    found = {}
    for name, size in SIZES.items():
        with given.open(
            plate(size), (32, 32), ("color_linear",), rays="whole", ambient=0.0, shadows="off", ray_mirror=0.0
        ) as renderer:
            found[name] = renderer.render(view(size)).image("color_linear").astype(np.float64)[..., 0]
        given.silent()
    whole = found["of metres"]
    given.need(
        0.05 < (whole < 0.1 * whole.max()).mean() < 0.5, "The plate casts no shadow in a scene of metres."
    )
    for name, picture in found.items():
        wrong = np.abs(picture - whole) > 0.02 * whole.max()
        given.need(
            wrong.mean() < 0.02,
            f"In a scene {name} {100 * wrong.mean():.0f} % of the pixels differ from the same scene of metres.",
        )


def plate(size: float) -> Scene:
    """Return a ground of two units with a plate half a unit above it, and light that comes aslant."""
    scale = np.diag((size, size, size, 1.0))
    small = scale @ translated(0.1, 0.0, 0.5) @ np.diag((0.4, 0.4, 0.4, 1.0))
    return quad_scene(
        Material(base_color=(0.5, 0.5, 0.5, 1.0), metallic=0.0, roughness=1.0),
        matrices=(scale, small, rotation((0.0, 1.0, 0.0), 0.9)),
        instance_materials=(0, 0),
        lights=(Light("directional", node=2, intensity=3.0),),
    )


def view(size: float) -> View:
    """Return what sees all of the ground from above."""
    pose = pose_looking_at((0.0, 0.0, 2.0 * size), (0.0, 0.0, 0.0))
    return View(pose, Orthographic(size, 0.5 * size, 4.0 * size))
