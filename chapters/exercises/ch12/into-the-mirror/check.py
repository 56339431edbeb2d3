"""A mirror at 45 degrees, and a wall that glows beside it: the mirror shows the wall."""

from __future__ import annotations

import numpy as np

from common.numerics.transforms import rotation
from common.scene import Material, Scene
from tests.support.glowing import glow_of
from tests.support.scenes import facing, quad_scene, translated
from tools.exercises.checking import Given

EV = -0.2630344058337938
"""The EV100 of exposure 1: nits are picture values."""
NITS = 0.5


def check(given: Given) -> None:
    """Once with the wall on the right, once on the left, and once with no mirrored rays."""
    for side, sign in (("right", 1.0), ("left", -1.0)):
        middles = []
        for bounces in (0, 1):
            with given.open(
                corner(sign), (16, 16), ("color_linear",), rays="whole", ambient=0.0, ray_bounces=bounces
            ) as renderer:
                picture = renderer.render(facing(ev100=EV)).image("color_linear").astype(np.float64)
            middles.append(float(picture[6:10, 6:10].mean()))
        given.silent()
        without, shown = middles
        given.need(
            without < 0.01 * NITS, f"Without mirrored rays the mirror shows {without:.3f}, and not black."
        )
        given.need(
            abs(shown - NITS) < 0.02 * NITS,
            f"The wall on the {side} glows with {NITS}, and the mirror shows {shown:.3f}.",
        )


def corner(sign: float) -> Scene:
    """Return a mirror in the middle of the view, turned by 45 degrees, and a wall far to its right (1) or left (-1)."""
    mirror = Material(base_color=(1.0, 1.0, 1.0, 1.0), metallic=1.0, roughness=0.0)
    turned = rotation((0.0, 1.0, 0.0), sign * np.pi / 4)
    wall = (
        translated(sign * 4.0) @ rotation((0.0, 1.0, 0.0), -sign * np.pi / 2) @ np.diag((2.0, 2.0, 2.0, 1.0))
    )
    return quad_scene(materials=(mirror, glow_of(NITS)), matrices=(turned, wall), instance_materials=(0, 1))
