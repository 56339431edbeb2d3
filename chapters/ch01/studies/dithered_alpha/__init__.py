"""Study: half transparent by leaving half of the pixels out, in a pattern that spreads them evenly."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from common.lessons import Study
from common.settings import knob

STUDY = Study(
    title="dithered alpha",
    idea="Half transparency without blending: each pixel is drawn or not, by sixteen thresholds spread over a tile.",
    order=23,
    features=("materials/ordered-dither-alpha",),
)


@dataclass(frozen=True)
class Settings:
    """The knobs of this study."""

    threshold: float = knob(0.5, "alpha below which nothing is drawn; 0: everything is", minimum=0, maximum=1)
    alpha: float = knob(
        -1.0, "alpha of the whole picture; -1: from 0 on the left to 1", minimum=-1, maximum=1
    )
    dither: bool = knob(True, "lower alpha by a part that differs from pixel to pixel")


UNIFORM_BYTES = 16


def uniforms(settings: Settings) -> np.ndarray:
    """Return what the shader reads, (4,) float32."""
    return np.array([settings.threshold, settings.alpha, settings.dither, 0.0], np.float32)
