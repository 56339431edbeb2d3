"""Transmittance, phase, slices and weights, by the formulas of the chapter in float64."""

from __future__ import annotations

from typing import Any

import numpy as np

from tools.exercises import Answer
from tools.exercises.checking import Given

EXTINCTION, WAY = 0.06, 10.0
"""Per metre, and metres."""
NEAR, FAR, SLICES = 0.01, 2.0, 64
GRID = (128, 72, 64)


def measure(given: Given) -> dict[str, Answer]:
    """Evaluate what the shaders do, with small numbers."""
    model: Any = given.module("fog.model")
    places = model.places_of(
        given.settings(fog_columns=GRID[0], fog_rows=GRID[1], fog_slices=GRID[2]), (1, 1)
    )

    def phase(cosine: float, g: float) -> float:
        d = (1 - abs(g)) ** 2 + 2 * abs(g) * (1 - cosine if g > 0 else 1 + cosine)
        return float((1 - g * g) / (4 * np.pi * d**1.5))

    left = float(np.exp(-EXTINCTION * WAY))
    return {
        "left": 100 * left,
        "half": float(np.log(2) / EXTINCTION),
        "two": 0.5 * 0.5 * 100,
        "slab": float(0.9 * 100 * (1 - left)),
        "albedo": (0.03 * 0.9 + 0.01 * 0.3) / 0.04,
        "alike": phase(0.3, 0.0),
        "ratio": phase(1.0, 0.4) / phase(-1.0, 0.4),
        "behind": "towards the lamp",
        "slices": float((FAR / NEAR) ** (1 / SLICES)),
        "record": float((places.pixels - places.froxels) * model.WORD_BYTES / 1e6),
        "share": 100 / 16,
        "rests": model.REST_FRAMES + 2,
    }
