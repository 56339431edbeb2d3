"""The knobs of temporal anti-aliasing."""

from __future__ import annotations

from dataclasses import dataclass

from common.settings import knob

from .jitter import SEQUENCES

MODES = ("off", "simple", "full")
VELOCITIES = ("own", "closest", "longest")
HISTORIES = ("bilinear", "catmull-rom")
FILTERS = ("none", "tent", "mitchell", "blackman-harris", "catmull-rom")
CONSTRAINTS = ("none", "clamp", "clip", "variance", "variance-clamp")
WEIGHTS = ("fixed", "contrast", "luminance", "difference")


@dataclass
class TaaSettings:
    """How the projection is jittered, and how frames become one picture."""

    taa: str = knob(
        "off",
        "temporal anti-aliasing; simple: every frame has the share taa_share, and of the other knobs that begin with "
        "taa_ only taa_format and taa_scale matter",
        choices=MODES,
    )
    taa_share: float = knob(
        0.1, "share of a new frame in the history while something moves", minimum=0.001, maximum=1
    )
    taa_average: bool = knob(
        True, "whether frames that show the same are averaged over whole periods, until the picture rests"
    )
    taa_velocity: str = knob(
        "closest", "the pixel of each 3x3 whose motion leads to the history", choices=VELOCITIES
    )
    taa_history: str = knob("catmull-rom", "filter by which the history is looked up", choices=HISTORIES)
    taa_filter: str = knob(
        "none",
        "filter that finds the colour of a pixel from the samples of 3x3 pixels, at taa_scale=1",
        choices=FILTERS,
    )
    taa_constraint: str = knob(
        "variance-clamp", "how the history is brought close to the colours of 3x3 pixels", choices=CONSTRAINTS
    )
    taa_gamma: float = knob(
        1.0,
        "standard deviations that a history may be away from the mean of 3x3 pixels, if variance constrains it",
        minimum=0,
        maximum=8,
    )
    taa_weight: str = knob("difference", "what the shares of frame and history depend on", choices=WEIGHTS)
    taa_ycocg: bool = knob(True, "whether boxes have axes along luminance and two differences of colour")
    taa_tolerance: float = knob(
        0.02,
        "relative difference of depth from which on a history shows another surface; 0: depth does not matter",
        minimum=0,
        maximum=1,
    )
    taa_reactive: float = knob(
        0.5, "how much the cover of transparent surfaces takes from the history", minimum=0, maximum=1
    )
    taa_format: str = knob("rgba32f", "format of the history", choices=("rgba16f", "rgba32f"))
    taa_scale: float = knob(
        1.0,
        "part of the picture's width and height that is drawn; below 1 the history makes the picture of fewer pixels",
        minimum=0.5,
        maximum=1,
    )
    jitter: str = knob("halton", "sequence of the shifts of the projection", choices=SEQUENCES)
    jitter_period: int = knob(8, "frames after which the sequence repeats", minimum=1, maximum=64)
    mip_bias: float = knob(
        -1.0, "added to the level of textures, since a history averages finer detail", minimum=-4, maximum=4
    )
    steady_uv: bool = knob(False, "whether textures are looked up where they would be without jitter")
