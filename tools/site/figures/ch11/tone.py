"""The tone curves over the light."""

from __future__ import annotations

from collections.abc import Callable

from tools.site.figures.canvas import Canvas
from tools.site.figures.charts import Axis, Curve, curves

WHITE, MOST = 4.0, 5.0
START = 0.8 - 0.04
"""Of the neutral curve (Khronos, "PBR Neutral Tone Mapper"): where it begins to bend."""


def neutral(light: float) -> float:
    """Return the neutral curve of grey light."""
    offset = light - 6.25 * light * light if light < 0.08 else 0.04
    value = light - offset
    if value < START:
        return value
    bend = 1.0 - START
    return 1.0 - bend * bend / (value + bend - START)


def reinhard(light: float) -> float:
    """Return Reinhard's curve with the white point WHITE."""
    value = min(light, WHITE)
    return value * (1 + value / WHITE**2) / (1 + value)


def aces(light: float) -> float:
    """Return Narkowicz' fit."""
    return min((light * (2.51 * light + 0.03)) / (light * (2.43 * light + 0.59) + 0.14), 1.0)


CURVES: dict[str, Callable[[float], float]] = {
    "neutral": neutral,
    "reinhard": reinhard,
    "aces": aces,
    "none": lambda light: min(light, 1.0),
}


def tone_curves() -> Canvas:
    """A curve for each choice of `tone_curve`."""
    lights = [MOST * i / 200 for i in range(201)]
    return curves(
        "Tone curves of grey light",
        Axis("light, after the exposure"),
        Axis("linear value that is shown"),
        [Curve(name, [(x, curve(x)) for x in lights], marks=False) for name, curve in CURVES.items()],
        "Reinhard with the default white point of 4; before the sRGB code",
    )
