"""The knobs of the environment: its light, and the maps that are computed before the first frame."""

from __future__ import annotations

from dataclasses import dataclass

from common.environment import ENERGIES
from common.settings import knob


@dataclass
class EnvironmentSettings:
    """How an environment lights the scene, and how exact its maps are."""

    energy: str = knob(
        "gltf",
        "how reflection shares the environment's light: as glTF prints it; with what bounces between facets; "
        "and with no more spread than mirroring leaves",
        choices=ENERGIES,
    )
    intensity: float = knob(
        1.0,
        "factor on the environment's light; 0: there is none",
        minimum=0,
        maximum=1e9,
        flat="environment_intensity",
    )
    turn: float = knob(
        0.0,
        "turn of the environment about the vertical",
        unit="degrees",
        minimum=-360,
        maximum=360,
        flat="environment_turn",
    )
    size: int = knob(
        256,
        "texels along an edge of the environment's cube, rounded down to a power of two",
        minimum=16,
        maximum=2048,
        flat="environment_size",
    )
    detail: float = knob(
        0.35,
        "texels summed as a whole for blurred levels, as a part of the lobe's width; time grows with its inverse "
        "square: 0.05 takes minutes in software",
        minimum=0.05,
        maximum=2,
        reference=0.15,
        flat="environment_detail",
    )
    irradiance_source: int = knob(
        32,
        "texels along an edge of the level that irradiance is summed over, rounded down to a power of two",
        minimum=4,
        maximum=256,
        reference=128,
    )
    table_size: int = knob(64, "cosines and roughnesses in the BRDF's table", minimum=8, maximum=512)
    table_samples: int = knob(
        1024, "samples of each number in the BRDF's table", minimum=16, maximum=65536, reference=4096
    )
