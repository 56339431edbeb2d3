"""The knobs of cloth."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from common.settings import knob


@dataclass
class ClothSettings:
    """How cloth is simulated."""

    enabled: bool = knob(True, "whether cloth moves; off: it is as it was modelled", flat="cloth")
    method: Literal["xpbd", "springs"] = knob(
        "xpbd", "by distances put right, or by forces", choices=("xpbd", "springs"), flat="cloth_method"
    )
    integrator: Literal["verlet", "euler"] = knob(
        "verlet", "how forces of springs become motion", choices=("verlet", "euler"), flat="cloth_integrator"
    )
    step: float = knob(
        1 / 60, "of the simulation", unit="s", minimum=1 / 1000, maximum=1 / 15, flat="cloth_step"
    )
    substeps: int = knob(
        16, "parts of a step; springs take more if needed", minimum=1, maximum=64, flat="cloth_substeps"
    )
    iterations: int = knob(
        1, "times that distances are put right in a part", minimum=1, maximum=64, flat="cloth_iterations"
    )
    execution: str = knob(
        "auto", "what moves it", choices=("auto", "group", "dispatch", "thread"), flat="cloth_execution"
    )
    wind_speed: float = knob(0.0, "of the wind on cloth", unit="m/s", minimum=0, maximum=60, live=True)
    wind_direction: float = knob(0.0, "0 +x, 90 -z", unit="degrees", minimum=-360, maximum=360, live=True)
