"""A picture from samples that were drawn at a scale, in float64: sums of a kernel over all samples of all frames."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from tests.twins.taa import harris

Float64 = NDArray[np.float64]

LEAST = 1e-5
"""The least weight of a sample of the 3x3."""


def sums(drawn: Float64, jitter: tuple[float, float], size: tuple[int, int], radius: float) -> Float64:
    """Return (H, W, 4) sums of weighted colours and of weights, for a picture of `size` (width, height) pixels.

    `drawn` (h, w, 3) was drawn with a shift of `jitter` drawn pixels right and down. A pixel takes the 3x3 samples
    around the drawn pixel in which its centre lies, and samples beyond the border are those of the border.
    """
    height, width = drawn.shape[:2]
    scale, last = np.array((size[0] / width, size[1] / height)), np.array((width - 1, height - 1))
    columns, rows = np.meshgrid(np.arange(size[0]), np.arange(size[1]))
    place = (np.stack([columns, rows], axis=-1) + 0.5) / scale + jitter
    middle = np.clip(np.floor(place).astype(int), 0, last)
    picture = np.zeros((size[1], size[0], 4))
    for down in (-1, 0, 1):
        for right in (-1, 0, 1):
            at = middle + np.array((right, down))
            away = (at + 0.5 - place) * scale
            weight = np.maximum(harris(away * 1.5 / radius, 1.5).prod(axis=-1), LEAST)[..., None]
            x, y = np.moveaxis(np.clip(at, 0, last), -1, 0)
            picture += weight * np.concatenate([drawn[y, x], np.ones_like(weight)], axis=-1)
    return picture


def mean(frames: Sequence[Float64]) -> Float64:
    """Return (H, W, 3) the mean of frames by their `sums`."""
    total: Float64 = np.sum(frames, axis=0)
    return total[..., :3] / total[..., 3:]
