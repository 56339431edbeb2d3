"""Lengths in texels and in metres: footprints, biases, guards, and the spheres of cascades."""

from __future__ import annotations

from typing import Any

import numpy as np

from common.numerics.transforms import pose_looking_at
from common.view.camera import Perspective, View
from tools.exercises import Answer
from tools.exercises.checking import Given

NAMES = ("+x", "-x", "+y", "-y", "+z", "-z")


def measure(given: Given) -> dict[str, Answer]:
    """Ask the chapter for its records and spheres, and evaluate the formulas of its shader."""
    faces: Any = given.module("shadows.faces")
    cascades: Any = given.module("shadows.cascades")
    model: Any = given.module("shadows.model")
    packing: Any = given.module("scene.packing")
    lights = np.zeros(1, packing.LIGHT)
    lights["kind"], lights["direction"] = packing.LIGHT_KINDS["point"], (0, 0, -1)
    knobs = given.settings()
    guard = int(model.guard(knobs, 256))
    (face, *_), *_ = faces.local_faces(
        lights, np.array([0]), np.array([256]), 0.01, np.array([50.0]), np.array([guard])
    )
    ahead = faces.cube_axes()[:, 2]
    slope = np.tan(np.radians(60.0))
    plane = knobs.shadows.shadow_constant + knobs.shadows.shadow_slope * slope
    view = View(pose_looking_at((0, 0, 0), (0, 0, -1)), Perspective(np.radians(60.0), 0.1))
    centre, radius = cascades.slice_sphere(view.projection, 2.0, 0.0, 10.0)
    used = 1024 - 2 * guard
    return {
        "guard": int(model.guard(given.settings(shadow_kernel=7), 256)),
        "factors": 3 * 3 + 1,
        "texel": 5.0 / float(face["scale_x"]) * 1000,
        "face": NAMES[int((ahead @ np.array([1.0, -2.0, 1.5])).argmax())],
        "offset": 1.5 * np.sqrt(2.0) * slope,
        "plane": plane,
        "gap": plane * np.cos(np.radians(60.0)),
        "centre": centre,
        "radius": radius,
        "coarse": 2 * radius / (used - used // cascades.STEPS) * 1000,
    }
