"""Squares of known light through each tone curve, against the curves' formulas and the sRGB code."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from common.images.color import encode_srgb
from common.scene import Material
from tests.support.scenes import facing, quad_scene, translated
from tools.exercises.checking import Given

LIGHT = (0.0, 0.02, 0.18, 0.7, 1.0, 6.0)


def check(given: Given) -> None:
    """An unlit material shows its base colour whatever the exposure, so the light is known."""
    curves: dict[str, Callable[[float], float]] = {
        "none": lambda x: min(x, 1.0),
        "reinhard": lambda x: x / (1.0 + x),
    }
    count = len(LIGHT)
    places = [translated(x=(2 * n + 1) / count - 1) @ np.diag([1 / count, 1, 1, 1]) for n in range(count)]
    materials = tuple(Material(unlit=True, base_color=(value, value, value, 1.0)) for value in LIGHT)
    scene = quad_scene(materials=materials, matrices=tuple(places), instance_materials=tuple(range(count)))
    for curve, formula in curves.items():
        picture = given.draw(scene, facing(), "color", (4 * count, 4 * count), tone_curve=curve)
        for number, value in enumerate(LIGHT):
            seen = float(picture[8, 4 * number + 2, 0])
            wanted = 255.0 * float(encode_srgb(np.array(formula(value))))
            given.need(
                abs(seen - wanted) <= 0.51 + 1e-3 * wanted,
                f"With tone_curve={curve} light of {value:g} is code {seen:.0f}, and it should be {wanted:.1f}.",
            )
    bright = Material(unlit=True, base_color=(6.0, 6.0, 6.0, 1.0))
    shown = given.draw(quad_scene(bright), facing(), "color", (4, 4), tone_curve="neutral")[2, 2, 0]
    given.need(250 <= shown < 255, "With tone_curve=neutral light of 6 is not what it was.")
    coloured = Material(unlit=True, base_color=(4.0, 0.5, 0.0, 1.0))
    picture = given.draw(quad_scene(coloured), facing(), "color", (4, 4), tone_curve="reinhard")
    wanted_rgb = 255.0 * encode_srgb(np.array([4 / 5, 0.5 / 1.5, 0.0]))
    given.need(
        np.abs(picture[2, 2] - wanted_rgb).max() <= 1.0,
        "With tone_curve=reinhard each channel is bent by itself.",
    )
