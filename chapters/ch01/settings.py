"""The knobs of this chapter, each with its unit, range and default."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

from common.settings import knob


@dataclass
class Settings:
    """What can be turned without touching the code: `strata run 1 --set anisotropy=1`."""

    PRESETS: ClassVar[dict[str, dict[str, Any]]] = {
        "low": {"anisotropy": 1.0, "color_format": "rgba16f"},
        "medium": {"anisotropy": 4.0, "color_format": "rgba16f"},
        "high": {"anisotropy": 16.0, "color_format": "rgba16f"},
        "reference": {"anisotropy": 16.0, "color_format": "rgba32f"},
    }

    anisotropy: float = knob(
        4.0, "texels averaged along the longer axis of a pixel's footprint", minimum=1, maximum=16
    )
    color_format: str = knob("rgba16f", "format of the linear colour target", choices=("rgba16f", "rgba32f"))
    tone_curve: str = knob(
        "neutral", "how bright colours are rolled off to white", choices=("neutral", "none")
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
        0.0,
        "exposed illuminance below which a light without range ends; 0: it reaches everything",
        unit="lux x exposure",
        minimum=0,
        maximum=1,
    )
    background: float = knob(
        0.02, "linear grey where nothing was drawn, after exposure", minimum=0, maximum=1000
    )
    skip_unused: bool = knob(True, "whether what the scene does not need is left out of pipelines and sets")
