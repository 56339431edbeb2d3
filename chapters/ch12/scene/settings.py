"""The knobs of the scene: its textures, and the light that it brings."""

from __future__ import annotations

from dataclasses import dataclass

from common.settings import knob


@dataclass
class SceneSettings:
    """How the scene is sampled and lit."""

    anisotropy: float = knob(
        4.0, "texels averaged along the longer axis of a pixel's footprint", minimum=1, maximum=16
    )
    ambient: float = knob(
        -1.0,
        "light that arrives from every direction alike; -1: what the scene says, else a little where it has no lights",
        unit="nits",
        minimum=-1,
        maximum=1e9,
    )
    default_light: bool = knob(
        True, "whether a scene without lights gets one that shines from behind the camera"
    )
    light_cutoff: float = knob(
        0.001,
        "illuminance below which a light ends, if its range is not shorter; 0: it reaches everything",
        unit="lux",
        minimum=0,
        maximum=1000,
    )
