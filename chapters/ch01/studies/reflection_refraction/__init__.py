"""Study: a ball of ice under the sky. Which way a ray turns at a surface, and how much of the light goes each way."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from common.environment import Environment
from common.environment.directions import panorama_directions
from common.environment.sky import sky
from common.lessons import Study
from common.settings import knob
from common.view.camera import View, exposure

from ..full_screen import rays

STUDY = Study(
    title="reflection and refraction",
    idea="At a surface light is mirrored and bent, and the angle decides how much of it goes each way.",
    order=21,
    features=("environment/reflection-refraction",),
)

RADIUS = 0.85
"""Of the ball, in metres; its centre is the origin."""


@dataclass(frozen=True)
class Settings:
    """The knobs of this study."""

    index: float = knob(
        1.31, "refractive index of the ball: 1.31 ice, 1.5 glass, 2.4 diamond", minimum=1, maximum=4
    )
    show: str = knob("both", "which light is shown", choices=("both", "reflected", "refracted"))
    surfaces: int = knob(
        2, "surfaces that bend a ray: 1 only where it enters, 2 also where it leaves", "", 1, 2
    )
    altitude_deg: float = knob(35.0, "height of the sun", "degrees", 5, 90)
    brightness: float = knob(6.0e-5, "factor on the sky's nits", minimum=0, maximum=1e6)


UNIFORM_BYTES = (24 + 4 + 4) * 4


def around(settings: Settings) -> Environment:
    """Return the sky with its sun, over a floor of tiles: what is bent should have edges."""
    clear = sky(math.radians(settings.altitude_deg), height=256)
    x, y, z = np.moveaxis(panorama_directions(256), -1, 0)
    below = np.minimum(y, -1e-3)
    tile = (np.floor(x / below) + np.floor(z / below)) % 2  # a metre wide, a metre below
    strength = np.clip(-5.0 * y - 0.4, 0.0, 0.8)  # far tiles are smaller than a texel: none there
    light = clear.radiance * (1.0 - strength * tile)[..., None]
    return Environment("sky over tiles", light.astype(np.float32))


def uniforms(settings: Settings, view: View, aspect: float) -> np.ndarray:
    """Return what the shader reads, (32,) float32: rays, ball, and what is shown."""
    mirrored, bent = settings.show != "refracted", settings.show != "reflected"
    ball = [RADIUS, settings.index, settings.surfaces, settings.brightness * exposure(view.ev100)]
    return np.concatenate([rays(view, aspect), ball, [mirrored, bent, 0.0, 0.0]]).astype(np.float32)
