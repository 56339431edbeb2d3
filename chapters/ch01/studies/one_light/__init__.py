"""Study: an object of a glTF file in the light of one lamp. Normals, photometric units, Lambert's law, exposure."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from common.lessons import Study
from common.scene import Scene
from common.scene.primitive import Primitive, matrices
from common.settings import knob
from common.view.camera import View, exposure

from .. import textured_mesh

STUDY = Study(
    title="one light",
    idea="A matt surface is as bright as what falls on it, and distance and angle decide how much that is.",
    order=5,
    outputs=("color", "depth"),
    scene="spheres",
)


@dataclass(frozen=True)
class Settings:
    """The knobs of this study."""

    instance: int = knob(0, "number of the object that is drawn", minimum=0)
    brightness: float = knob(
        1.0,
        "luminance of a white surface at the lamp's nearest point of the object's sphere, facing it",
        unit="nits",
        minimum=0,
        maximum=1e6,
    )


STREAMS = {**textured_mesh.STREAMS, "normals": (2, 3)}
UNIFORM_BYTES = textured_mesh.UNIFORM_BYTES + 2 * 16

DISTANCE = 2.0
"""From the object's centre to the lamp, in radii of the sphere around the object."""


def lamp(scene: Scene, settings: Settings, time: float) -> tuple[np.ndarray, float]:
    """Return the lamp's place relative to the object's centre (3,), and its intensity in candela.

    It goes round the object once in 2 pi seconds, 45 degrees above. Something matt and white that faces a lamp of
    I candela at d metres gets I / d^2 lux and sends a pi-th of that to wherever you stand, in nits.
    """
    radius, angle = scene.length_scale, time % (2.0 * np.pi)
    direction = np.array([np.sin(angle), 1.0, np.cos(angle)]) * np.sqrt(0.5)
    nearest = (DISTANCE - 1.0) * radius
    return direction * DISTANCE * radius, settings.brightness * np.pi * nearest**2


def uniforms(
    scene: Scene, primitive: Primitive, settings: Settings, view: View, time: float, aspect: float
) -> np.ndarray:
    """Return what the shaders read, (44,) float32: matrices, base colour, the lamp's place and exposed intensity."""
    place, intensity = lamp(scene, settings, time)
    still = matrices(scene, view, 0.0, aspect).ravel()
    # The exposure belongs to the camera, but multiplying here keeps everything near 1: a sun has 100,000 lux, and
    # half floats, which the chapter draws to, end at 65,504.
    color = np.full(3, intensity * exposure(view.ev100))
    return np.concatenate([still, primitive.material.base_color, place, [0.0], color, [0.0]]).astype(
        np.float32
    )
