"""Study: Phong's highlight, and two lights. Light adds up; what a screen cannot show is cut off only at the end."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from common.lessons import Study
from common.scene import Scene
from common.scene.primitive import Primitive, matrices
from common.settings import knob
from common.view.camera import Orthographic, View, exposure

from .. import one_light

STUDY = Study(
    title="phong",
    idea="A highlight is a power of a cosine, and the light of two lamps is the sum of what each of them gives.",
    order=20,
    features=("lighting/phong",),
    outputs=("color", "depth"),
    scene="spheres",
)


@dataclass(frozen=True)
class Settings:
    """The knobs of this study. Lengths are in radii of the sphere around the object."""

    instance: int = knob(0, "number of the object that is drawn", minimum=0)
    lights: str = knob("both", "which lights are on", choices=("both", "lamp", "spot"))
    brightness: float = knob(1.0, "factor on both lights", minimum=0, maximum=1e6)
    ambient: float = knob(
        0.02, "part of a light that reaches every place from everywhere", minimum=0, maximum=1
    )
    specular: float = knob(0.5, "part of a light that the highlight shows at its peak", minimum=0, maximum=1)
    shininess: float = knob(40.0, "power of the highlight's cosine", minimum=1, maximum=1000)
    linear: float = knob(0.2, "linear term of the attenuation, per radius", minimum=0, maximum=100)
    quadratic: float = knob(0.1, "quadratic term of the attenuation, per radius^2", minimum=0, maximum=100)
    cone_deg: float = knob(20.0, "angle from the spot's axis to where its light ends", "degrees", 1, 89)
    softness: float = knob(
        0.3, "part of that angle over which the spot's light fades", minimum=0.001, maximum=1
    )


STREAMS = one_light.STREAMS
UNIFORM_BYTES = (36 + 4 * 3 + 2 * 4 * 4) * 4

LAMP_COLOR, SPOT_COLOR = (1.2, 1.0, 0.7), (0.5, 1.0, 2.0)
SPOT_PLACE = np.array([-1.6, 0.9, 1.6])
"""The spot stands still, in radii from the object's centre, which it looks at."""


def lights(settings: Settings, radius: float, time: float, exposed: float) -> np.ndarray:
    """Return (2, 4, 4) float64, a lamp that goes round as in one-light and a spot: place, colour, axis, cosines.

    The cosines are those of the angles at which a light has ended and at which it begins to fade.
    """
    angle = time % (2.0 * np.pi)
    lamp = np.array([np.sin(angle), 1.0, np.cos(angle)]) * np.sqrt(0.5) * one_light.DISTANCE
    outer = np.radians(settings.cone_deg)
    cosines = np.cos(outer), np.cos(outer * (1.0 - settings.softness))
    records = np.zeros((2, 4, 4))
    records[:, 0, :3] = lamp * radius, SPOT_PLACE * radius
    records[0, 1, :3] = np.multiply(LAMP_COLOR, (settings.lights != "spot") * settings.brightness * exposed)
    records[1, 1, :3] = np.multiply(SPOT_COLOR, (settings.lights != "lamp") * settings.brightness * exposed)
    records[:, 2, :3] = -lamp / np.linalg.norm(lamp), -SPOT_PLACE / np.linalg.norm(SPOT_PLACE)
    records[0, 3, :2] = -3.0, -2.0  # every cosine is above these: the lamp has no cone
    records[1, 3, :2] = cosines
    return records


def uniforms(
    scene: Scene, primitive: Primitive, settings: Settings, view: View, time: float, aspect: float
) -> np.ndarray:
    """Return what the shaders read, (80,) float32: that of textured-mesh, then eye, surface, attenuation, lights."""
    radius = scene.length_scale
    still = matrices(scene, view, 0.0, aspect).ravel()
    # Highlights move with the eye. An orthographic one is infinitely far: then w is 0, and the rest a direction.
    near = not isinstance(view.projection, Orthographic)
    eye = [*(view.eye - scene.origin), 1.0] if near else [*view.world_from_view[:3, 2], 0.0]
    surface = [settings.ambient, settings.specular, settings.shininess, 0.0]
    attenuation = [1.0, settings.linear / radius, settings.quadratic / radius**2, 0.0]
    both = lights(settings, radius, time, exposure(view.ev100)).ravel()
    return np.concatenate([still, primitive.material.base_color, eye, surface, attenuation, both]).astype(
        np.float32
    )
