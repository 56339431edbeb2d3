"""What workers of a sweep do with a part in tests, in place of tracing it: found by name in processes of their own."""

from __future__ import annotations

import os

import numpy as np

from tools.reference.sweep.work import Blocks, Part


def blocks_of(part: Part) -> Blocks:
    """Return blocks of numbers that follow from the reference and the number of the first path of each block."""
    width, height = part.request.size
    sums, first = [], part.first
    for count in part.counts:
        noise = np.random.default_rng((part.reference, first))
        light = noise.uniform(0.0, 100.0, (height, width, 4)).astype(np.float32)
        light[..., 3] = count
        squares = (light[..., :2] ** 2 * np.float32(1.5)).astype(np.float32)
        squares[..., 1] = 0.0
        sums.append((light, squares))
        first += count
    return Blocks(tuple(sums), "made up", 0.25)


def blocks_or_end(part: Part) -> Blocks:
    """Return the same, but end the process at the second part of a reference with seed 1."""
    if part.request.seed == 1 and part.first > 0:
        os._exit(1)
    return blocks_of(part)
