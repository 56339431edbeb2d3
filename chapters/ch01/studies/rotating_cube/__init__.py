"""Study: a cube that turns. Numbers that change from frame to frame reach the shader, and depth sorts the faces."""

from __future__ import annotations

import math

import numpy as np

from common.lessons import Study
from common.numerics.transforms import rotation
from common.view.camera import View

STUDY = Study(
    title="rotating cube",
    idea="What changes reaches shaders in a uniform buffer, one per frame in flight; depth decides what is in front.",
    order=3,
    features=("intro/rotating-cube",),
    outputs=("color", "depth"),
)

AXIS = (1.0, 1.0, 1.0)
"""The cube turns about its diagonal, one radian a second."""


def matrices(view: View, time: float, aspect: float) -> np.ndarray:
    """Return what the shader reads, (2, 4, 4) float32: view_from_object and clip_from_view, columns first."""
    # Only the part of the time within the current turn: then each turn repeats the last one to the bit, and the angle
    # stays small. All of it in double precision; what becomes a float is the product.
    world_from_object = rotation(np.array(AXIS) / math.sqrt(3.0), time % math.tau)
    view_from_object = view.view_from_world() @ world_from_object
    # numpy keeps rows together, GLSL columns.
    return np.stack([view_from_object.T, view.clip_from_view(aspect).T]).astype(np.float32)
