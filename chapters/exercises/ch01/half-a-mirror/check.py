"""A square and its mirror image are both seen from the front, and neither from behind."""

from __future__ import annotations

import numpy as np

from common.numerics.transforms import rotation
from common.scene import Material
from tests.support.scenes import facing, quad_scene, translated
from tools.exercises.checking import Given

SMALL = np.diag([0.4, 0.4, 1.0, 1.0])
MIRROR = np.diag([-0.4, 0.4, 1.0, 1.0])


def check(given: Given) -> None:
    """The left half of the picture has the first of two squares, the right half the second."""
    for names, pair in {
        ("square", "mirror image"): (SMALL, MIRROR),
        ("mirror image", "square"): (MIRROR, SMALL),
    }.items():
        places = [translated(x=x) @ matrix for x, matrix in zip((-0.5, 0.5), pair, strict=True)]
        picture = given.draw(quad_scene(Material(unlit=True), matrices=tuple(places)), facing())[..., 0]
        for name, column in zip(names, (8, 24), strict=True):
            given.need(
                picture[16, column] > 0.5,
                f"The {name} is not seen when the {names[0]} comes first in the scene.",
            )
        turn = rotation((0, 1, 0), np.pi)
        behind = tuple(
            translated(x=place[0, 3]) @ turn @ np.diag([*np.diag(place)[:3], 1.0]) for place in places
        )
        picture = given.draw(quad_scene(Material(unlit=True), matrices=behind), facing())
        given.need(picture.max() == 0.0, "Something is seen from behind: culling has to stay on.")
