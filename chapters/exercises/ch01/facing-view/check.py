"""Leaning squares under the view `facing`: known cosines, with a camera that has an eye and with one that has none."""

from __future__ import annotations

import math

import numpy as np

from common.numerics.transforms import pose_looking_at, rotation
from common.scene import Material
from common.view.camera import Perspective, View
from tests.support.scenes import facing, quad_scene
from tools.exercises.checking import Given


def check(given: Given) -> None:
    """Look from the front, from a corner, and at something unlit."""
    names = given.module("shading.views").NAMES
    given.need("facing" in names, "There is no view facing yet.")
    given.need(
        names[-1] == "facing", "A new view goes to the end: the numbers of the others are part of shaders."
    )
    for angle in (0.0, 0.5, 1.2):
        scene = quad_scene(Material(), matrices=(rotation((0, 1, 0), angle),))
        codes = given.draw(scene, facing(), "color", (16, 16), view="facing")[8, 6:10, 0] / 255
        _hold(given, codes, np.full(4, math.cos(angle)), f"that leans by {math.degrees(angle):.0f} degrees")
    # From 1 m before it and 90 degrees wide, the square fills the picture: its point (x, y) is seen along (x, y, -1).
    view = View(pose_looking_at((0.0, 0.0, 1.0), (0.0, 0.0, 0.0)), Perspective(math.pi / 2))
    codes = given.draw(quad_scene(Material()), view, "color", (16, 16), view="facing")[..., 0] / 255
    x = (np.arange(16) + 0.5) / 8 - 1
    wanted = 1 / np.sqrt(1 + x[:, None] ** 2 + x**2)
    _hold(given, codes, wanted, "before an eye 1 m away, at its worst place,")
    codes = given.draw(quad_scene(Material(unlit=True)), facing(), "color", (8, 8), view="facing")
    given.need(codes.max() == 0, "An unlit square is not black.")


def _hold(given: Given, shown: np.ndarray, wanted: np.ndarray, what: str) -> None:
    """Hold values to cosines, to half a code and what rounding takes."""
    worst = np.abs(shown - wanted).argmax()
    seen, cosine = shown.flat[worst], wanted.flat[worst]
    given.need(
        abs(seen - cosine) <= 1.1 / 255, f"A square {what} is {seen:.2f}, and the cosine is {cosine:.2f}."
    )
