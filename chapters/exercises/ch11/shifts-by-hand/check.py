"""Sequences, shares and filters by the formulas of the chapter in float64."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from tools.exercises import Answer
from tools.exercises.checking import Given

WIDTH, SHARE = 1920, 0.1


def measure(given: Given) -> dict[str, Answer]:
    """Evaluate what the chapter does, with small numbers."""
    jitter: Any = given.module("taa.jitter")
    model: Any = given.module("taa.model")
    points = jitter.raw("halton", np.arange(8), 8)
    left_over = SHARE / (1 - (1 - SHARE) * math.cos(math.pi * 0.25))
    moved = model.Shares(SHARE, 16, True)
    first = moved.frames_to_rest
    for still in (True, False):
        moved.next(still, True)
    return {
        "inverse": float(jitter.raw("halton", np.arange(8), 8)[4, 1]),
        "mean": float(points[:, 0].mean() - 0.5),
        "ndc": 1e4 * 2 * 0.25 / WIDTH,
        "side": "left",
        "old": 100 * SHARE * (1 - SHARE) ** 10,
        "each": 100 / (model.REST_PERIODS * 8),
        "first": first,
        "later": moved.frames_to_rest,
        "vector": 12 / WIDTH,
        "stripes": 100 * left_over,
    }
