"""Codes, texels, edges, turns and fragments, by the chapter's own functions where it has them."""

from __future__ import annotations

from typing import Any

import numpy as np

from tools.exercises import Answer
from tools.exercises.checking import Given

TEXEL, THRESHOLD = 16, 0.1
"""Those of the questions."""
INVOCATIONS = 64
"""Of a work group that lights."""


def measure(given: Given) -> dict[str, Answer]:
    """Evaluate what the shaders do, with small numbers."""
    model: Any = given.module("rates.model")
    width, height = model.decode(6)
    y, x = np.indices((8, 8))
    state: Any = given.module("rates.vulkan").rates_of_attachment()
    rates = {0: "1x1", 1: "2x1"}
    diagonal = np.arange(32) // 2
    return {
        "code": model.encode(4, 2),
        "pixels": width * height,
        "texels": -(-1920 // TEXEL) * -(-1080 // TEXEL),
        "step": 255 * float(np.sqrt(THRESHOLD)) / 4,
        "reads": (model.EDGE_TILE + 2) ** 2,
        "evaluations": TEXEL**2 + 15 * TEXEL**2 // 4,
        "small": 4 + (64 * 64 - 4) // 4,
        "rounds": -(-(10 + (model.AREA**2 // 16 - 10) * 16) // INVOCATIONS),
        "lit": min(1916 + 4 // 2, 1918 - 1),
        "turns": int(((3 * x + 5 * y + 2) & 7 == 0).sum()),
        "diagonal": 16 * 16 + len({*diagonal.tolist()}),
        "combined": rates[int(state.combinerOps[1])],
    }
