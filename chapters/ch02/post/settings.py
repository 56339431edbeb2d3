"""The knobs of what follows shading."""

from __future__ import annotations

from dataclasses import dataclass

from common.settings import knob


@dataclass
class PostSettings:
    """How the picture is made of what was shaded."""

    resolve: str = knob(
        "tone-weighted",
        "how a pixel's samples become one colour: averaged as they will be shown, or as light",
        choices=("tone-weighted", "linear"),
    )
    tone_curve: str = knob(
        "neutral", "how bright colours are rolled off to white", choices=("neutral", "none")
    )
