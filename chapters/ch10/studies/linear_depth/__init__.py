"""Study: what a depth image of a lamp holds, and how far from the lamp that is, with reversed and with standard Z.

A perspective projection keeps an affine function of 1/distance, so that planes stay planes on the screen:

    standard  (far / (far - near)) (1 - near / z)        0 at the near plane, 1 at the far plane
    reversed  (near / (far - near)) (far / z - 1)        1 at the near plane, 0 at the far plane

Both are solved for z in [`depth.glsl`](depth.glsl). From a hundred near planes on, standard depth is within 1 % of 1.
There the steps of a float are 2^-24, and one step of depth is z^2 / near * 2^-24 metres. Reversed depth becomes small,
where steps of a float are small, too: one step is at most z * 2^-23 metres, whatever the near plane is.

The picture has standard Z above and reversed Z below: the depth as it is stored, the distance, and the distance's error
on a scale of powers of ten, from 0.1 micrometres in black to 1 metre in white.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from common.lessons import Study
from common.scene import Sampler
from common.settings import knob

STUDY = Study(
    title="linear depth",
    idea="Depth is affine in 1 / distance; reversed, the steps of floats grow with the distance, not with its square.",
    order=1,
    features=("shadows/depth-recording",),
    outputs=("color", "depth", "standard_depth", "distance"),
)

CARDS = 7
"""Cards that face the lamp, each twice as far away as the one before."""

NEAREST = 1.5
"""Metres to the first card."""

TANGENT = 0.75
"""Of half the angle that the picture shows from top to bottom."""

FLOOR = 1.0
"""Metres from the lamp down to the floor."""

PANELS = (3, 2)
"""Columns and rows of the picture, each of which shows the whole image of the lamp."""

FOLDER = "studies/linear_depth"
RECORD = (f"{FOLDER}/record.vert", f"{FOLDER}/distance.frag")
SHADERS = ("post/fullscreen.vert", f"{FOLDER}/show.frag")

TEXELS = Sampler(mag="nearest", min="nearest", mipmap=None, wrap_u="clamp", wrap_v="clamp")


@dataclass(frozen=True)
class Settings:
    """The knobs of this study."""

    near: float = knob(0.01, "metres to the near plane", minimum=1e-4, maximum=1.0)
    far: float = knob(100.0, "metres to the far plane, behind the last card", minimum=97.0, maximum=1e6)


def defines(standard: bool) -> tuple[tuple[str, int | float], ...]:
    """Return the macros of the shaders that record depth."""
    return (("CARDS", CARDS), ("NEAREST", NEAREST), ("FLOOR", FLOOR), ("STANDARD", int(standard)))


def vertices() -> int:
    """Return how many vertices the floor and the cards have."""
    return 6 * (1 + CARDS)


def push(settings: Settings, size: tuple[int, int]) -> np.ndarray:
    """Return the push constants, (4,) float32: tangents of half the angles across and down, near and far plane."""
    aspect = size[0] * PANELS[1] / (size[1] * PANELS[0])
    return np.array([TANGENT * aspect, TANGENT, settings.near, settings.far], np.float32)
