"""Study: metallic-roughness with Burley's diffuse part, in the light of a sun and of a whole sky."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from common.environment import Environment
from common.environment.directions import panorama_directions, panorama_solid_angles
from common.environment.sky import sky
from common.lessons import Study
from common.settings import knob

STUDY = Study(
    title="Burley and Smith",
    idea="Rough matt surfaces send light back at their rim, and an environment's diffuse light is one sum per normal.",
    order=24,
    features=("pbr/burley-smith", "ibl/diffuse"),
)


@dataclass(frozen=True)
class Settings:
    """The knobs of this study."""

    show: str = knob("both", "which light is shown", choices=("both", "sun", "sky"))
    illuminance: float = knob(2.0, "of the sun on a surface that faces it", "lux", minimum=0, maximum=1e6)
    sky: str = knob(
        "clear", "what lies around: a clear day, or 0.5 nits from everywhere", choices=("clear", "even")
    )
    brightness: float = knob(3.0e-5, "factor on the clear sky's nits", minimum=0, maximum=1e6)
    red: float = knob(0.8, "base colour", minimum=0, maximum=1)
    green: float = knob(0.4, "base colour", minimum=0, maximum=1)
    blue: float = knob(0.2, "base colour", minimum=0, maximum=1)


BALLS = (5, 2)
"""Roughness grows to the right, from 0 to 1; the upper row is dielectric, the lower one metal."""

SUN = np.array([0.5, 0.6, 0.62])
"""Where the sun is: the eye is at +z."""

UNIFORM_BYTES = 3 * 16
EVEN = 0.5
HEIGHT = 16


def irradiance(source: Environment, height: int = HEIGHT) -> Environment:
    """Return for each direction of a small panorama what a white matt surface that faces it sends on, in nits.

    That is the irradiance divided by pi: the mean of the light over the hemisphere, weighted by the cosine. It changes
    so slowly from normal to normal that 16 rows are enough. A sum in float64 over means of at least 32 rows; its
    weights are divided by their sum, so that even light stays what it is.
    """
    rows = len(source.radiance)
    step = max(1, rows // 32)  # means of squares: a sum over 2,048 places for each of 512
    area = np.broadcast_to(panorama_solid_angles(rows), (rows, 2 * rows))

    def coarse(values: np.ndarray) -> np.ndarray:
        return values.reshape(rows // step, step, 2 * rows // step, step, -1).sum(axis=(1, 3))

    weight = coarse(area)[..., 0]
    light = coarse(source.radiance * area[..., None]) / weight[..., None]
    normals, towards = panorama_directions(height).reshape(-1, 3), panorama_directions(rows // step)
    cosine = np.maximum(normals @ towards.reshape(-1, 3).T, 0.0) * weight.ravel()
    mean = cosine @ light.reshape(-1, 3) / cosine.sum(axis=1, keepdims=True)
    return Environment(f"irradiance of {source.name}", mean.reshape(height, 2 * height, 3).astype(np.float32))


def around(settings: Settings) -> Environment:
    """Return the irradiance of what lies around, without its sun, which is a light of its own."""
    if settings.sky == "even":
        return irradiance(Environment("even", np.full((2 * HEIGHT, 4 * HEIGHT, 3), EVEN, np.float32)))
    clear = sky(math.radians(40.0), height=64)
    # The brightest that the model's sky is beside its sun. What is above that is the pixels of the disc.
    light = np.minimum(clear.radiance, 2e4) * np.float32(settings.brightness)
    return irradiance(Environment(clear.name, light))


def uniforms(settings: Settings, size: tuple[int, int]) -> np.ndarray:
    """Return what the shader reads, (12,) float32: base colour and lux, the sun's direction, sky's part, balls."""
    lux = settings.illuminance * (settings.show != "sky")
    sun = SUN / np.linalg.norm(SUN)
    cell = np.array(size) / BALLS
    wider = cell / cell.min()  # a cell in units of its shorter side
    return np.array(
        [settings.red, settings.green, settings.blue, lux, *sun, settings.show != "sun", *BALLS, *wider],
        np.float32,
    )
