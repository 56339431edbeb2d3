"""Study: noise from the digits of a sine, and why not. Beside it noise from whole numbers, the same everywhere."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from common.lessons import Study
from common.settings import knob

STUDY = Study(
    title="sine hash",
    idea="The last digits of a sine look random, but no two drivers agree on them; whole numbers they all agree on.",
    order=22,
    features=("noise/sin-hash",),
)


@dataclass(frozen=True)
class Settings:
    """The knobs of this study."""

    cells: int = knob(24, "cells of noise in the height of the picture", minimum=1, maximum=4096)


UNIFORM_BYTES = 16


def uniforms(settings: Settings, size: tuple[int, int]) -> np.ndarray:
    """Return what the shader reads, (4,) float32: the number of cells along x and y."""
    return np.array([settings.cells * size[0] / size[1], settings.cells, 0.0, 0.0], np.float32)
