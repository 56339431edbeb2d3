"""The knobs of what follows shading."""

from __future__ import annotations

from dataclasses import dataclass

from common.settings import knob

RAW = "color_bloomed"
"""The picture that the raw part of a split view shows: what the lens gives, before anything finishes it."""


@dataclass
class PostSettings:
    """How the picture is made of what was shaded."""

    aperture: float = knob(0.0, "f-number of the lens; 0: a pinhole, all is sharp", minimum=0, maximum=1000)
    focus_distance: float = knob(0.0, "of what is sharp; 0: the middle's", unit="m", minimum=0, maximum=1e9)
    bokeh_taps: int = knob(8, "samples along the radius of the largest blur", minimum=2, maximum=32)
    resolve: str = knob(
        "tone-weighted",
        "how a pixel's samples become one colour: averaged as they will be shown, or as light",
        choices=("tone-weighted", "linear"),
    )
    tone_curve: str = knob(
        "neutral",
        "how bright colours are rolled off to white",
        choices=("neutral", "reinhard", "aces", "none"),
    )
    tone_white: float = knob(4.0, "value that Reinhard's curve shows as white", minimum=0.1, maximum=65504)
    motion_blur: float = knob(
        0.0, "how long the shutter is open: blur along motion", unit="frames", minimum=0, maximum=2
    )
    motion_blur_taps: int = knob(16, "samples along the motion of a pixel", minimum=2, maximum=64)
    motion_blur_limit: float = knob(
        64.0, "longest streak that a pixel is blurred to", unit="px", minimum=1, maximum=1024
    )
    sharpen: float = knob(
        0.0, "part of the difference from the mean around that is added; 1: usual", minimum=0, maximum=2
    )
    fxaa: bool = knob(False, "whether edges of the finished picture are smoothed by their contrast")
    fxaa_contrast: float = knob(
        0.125, "least contrast of an edge, as a share of the brightest luma", minimum=0.01, maximum=1
    )
    fxaa_detail: float = knob(0.75, "how strongly single pixels are smoothed", minimum=0, maximum=1)
    fxaa_steps: int = knob(
        16, "how far an edge is followed, to both sides, to find its ends", unit="px", minimum=1, maximum=64
    )
    display_exposure: float = knob(
        1.0, "factor of light before the tone curve, for display alone", minimum=0, maximum=10
    )
    display_gamma: float = knob(
        1.0,
        "light after the tone curve is raised to 1 / gamma: above 1 it is brighter",
        minimum=0.1,
        maximum=10,
    )
    dither: float = knob(
        0.0, "noise before the picture is rounded to 8 bits", unit="codes", minimum=0, maximum=4
    )
    split: str = knob(
        "off",
        "which part shows the raw picture, clamped instead of finished: columns on the left, or rows above",
        choices=("off", "columns", "rows"),
    )
    split_at: float = knob(0.5, "part of the picture that is raw in a split view", minimum=0, maximum=1)
