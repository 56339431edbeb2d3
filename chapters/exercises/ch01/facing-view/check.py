"""Leaning squares under the view `facing`: known cosines, with a camera that has an eye and with one that has none."""

from __future__ import annotations

import math

import numpy as np

from chapters.exercises.checking import Given
from common.camera import Perspective, View
from common.scene import Material
from common.transforms import pose_looking_at, rotation
from tests.support.scenes import facing, quad_scene


def check(given: Given) -> None:
    """Look from the front, from a corner, and at something unlit."""
    names = given.module("logic.views").NAMES
    given.need("facing" in names, "There is no view facing yet.")
    given.need(
        names[-1] == "facing", "A new view goes to the end: the numbers of the others are part of shaders."
    )
    for angle in (0.0, 0.5, 1.2):
        scene = quad_scene(Material(), matrices=(rotation((0, 1, 0), angle),))
        codes = given.draw(scene, facing(), "color", (16, 16), view="facing")[8, 7:9].astype(float)
        given.need(
            np.abs(codes - 255 * math.cos(angle)).max() <= 1.0,
            f"A square that leans by {math.degrees(angle):.0f} degrees before an orthographic camera is "
            f"{codes.mean() / 255:.2f}, and the cosine is {math.cos(angle):.2f}.",
        )
    eye = np.array((1.0, 0.5, 1.5))
    view = View(pose_looking_at(tuple(eye), (0.0, 0.0, 0.0)), Perspective(0.2))
    codes = given.draw(quad_scene(Material()), view, "color", (16, 16), view="facing")[7:9, 7:9].astype(float)
    wanted = eye[2] / np.linalg.norm(eye)
    given.need(
        abs(codes.mean() / 255 - wanted) <= 0.01,
        f"A square seen from a corner is {codes.mean() / 255:.2f}, and the cosine is {wanted:.2f}.",
    )
    codes = given.draw(quad_scene(Material(unlit=True)), facing(), "color", (8, 8), view="facing")
    given.need(codes.max() == 0, "An unlit square is not black.")
