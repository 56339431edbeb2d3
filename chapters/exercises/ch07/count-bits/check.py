"""Tiles, words and bins of the light lists, as the chapter lays them out."""

from __future__ import annotations

from typing import Any

import numpy as np

from tools.exercises import Answer
from tools.exercises.checking import Given


def measure(given: Given) -> dict[str, Answer]:
    """Ask the chapter for its layout; bins follow from the bits of a float."""
    model: Any = given.module("clusters.model")
    layout: Any = model.ListLayout

    def code(depth: float) -> int:
        return int(np.float32(depth).view(np.uint32)) >> (23 - model.STEPS_LOG2)

    first_code = code(12.0) - model.BINS + 1
    edges = (np.arange(3, dtype=np.uint32) + code(10.0) << (23 - model.STEPS_LOG2)).view(np.float32)
    nearest = (np.uint32(first_code + 1) << np.uint32(23 - model.STEPS_LOG2)).view(np.float32)
    small, large = layout.of(256, (1280, 720), 1 << 27), layout.of(4096, (7680, 4320), 1 << 27)
    return {
        "tiles": int(np.prod(layout.of(64, (1281, 721), 1 << 27).tiles)),
        "words": layout.of(100, (1280, 720), 1 << 27).words_of_set,
        "word": 70 // 32,
        "bit": 70 % 32,
        "tile_bytes": (small.words - small.first_tile) * 4,
        "bin_bytes": (small.first_tile - small.first_depth) * 4,
        "bin_depth": float(edges[1] - edges[0]),
        "between": code(10.0) - code(5.0),
        "nearest": float(nearest),
        "tile_side": 1 << large.tile_log2,
    }
