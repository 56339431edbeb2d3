"""The knobs of what follows shading."""

from __future__ import annotations

from dataclasses import dataclass

from common.settings import knob


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
