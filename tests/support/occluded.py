"""Scenes, views and images for tests of ambient occlusion."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from common.numerics.transforms import pose_looking_at
from common.scene import Material, Scene
from common.view.camera import Orthographic, Perspective, View
from tests.support.scenes import quad_scene

METHODS = ("depth", "normals")
"""The two estimates."""

RAW, ACROSS, RESULT = (
    "ssao/ambient_occlusion_raw",
    "ssao_blur_x/ambient_occlusion_x",
    "ssao_blur/ambient_occlusion",
)
"""The images of an inspected frame: the estimate, and what each pass of the blur makes of it."""

STEP = 1 / 255
"""Of these images."""

EYE_VIEW = View(pose_looking_at((0.5, 2.0, 4.5), (0.0, 0.5, 0.0)), Perspective(0.9, 0.05))
FLAT_VIEW = View(pose_looking_at((1.0, 2.0, 4.0), (0.0, 0.5, 0.5)), Orthographic(2.0, 0.1, 20.0))
"""Views of `room`, one in perspective."""


def codes(frame: Any, name: str) -> NDArray[np.int64]:
    """Return an image of occlusion (H, W) as integers of 0 to 255."""
    image = frame.image(name)
    return np.asarray(image.reshape(image.shape[:2]), np.int64)


def room(*more: np.ndarray) -> Scene:
    """Return a floor and a wall that meet at the x axis, the floor towards +z, and other squares of such matrices."""
    floor = np.eye(4)
    floor[:3, :3] = [[4, 0, 0], [0, 0, 1], [0, -4, 0]]
    floor[:3, 3] = 0, 0, 4
    wall = np.diag((4.0, 4.0, 1.0, 1.0))
    wall[:3, 3] = 0, 4, 0
    return quad_scene(Material(roughness=0.9, double_sided=True), matrices=(floor, wall, *more))


def slanted() -> Scene:
    """Return one square that covers the whole of views from the front, turned by 60 degrees about y."""
    c, s = 0.5, np.sqrt(0.75)
    matrix = np.eye(4)
    matrix[:3, :3] = np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]]) * 12
    return quad_scene(Material(double_sided=True), matrices=(matrix,))
