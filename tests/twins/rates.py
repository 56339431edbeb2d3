"""Masks of shading rates in float64."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


def luminance_code(light: Floats) -> Floats:
    """Return the sRGB code of the luminance of linear light (H, W, 3), without a tone curve."""
    value = np.clip(light[..., :3], 0.0, 1.0) @ np.array((0.2126, 0.7152, 0.0722))
    coded: Floats = np.where(value <= 0.0031308, 12.92 * value, 1.055 * value ** (1 / 2.4) - 0.055)
    return coded


def squared_gradient(values: Floats) -> Floats:
    """Return the squared gradient of (H, W) values; those of the border stand for what lies beyond it.

    It is that of Sobel, or four times the step to the next pixel to the right or below, if that is more.
    """
    height, width = values.shape
    padded = np.pad(values, 1, mode="edge")
    part = {(y, x): padded[y : y + height, x : x + width] for y in range(3) for x in range(3)}
    across = part[0, 0] - part[0, 2] + 2 * (part[1, 0] - part[1, 2]) + part[2, 0] - part[2, 2]
    down = part[0, 0] - part[2, 0] + 2 * (part[0, 1] - part[2, 1]) + part[0, 2] - part[2, 2]
    steps = 4 * (part[1, 2] - part[1, 1]), 4 * (part[2, 1] - part[1, 1])
    squared: Floats = np.maximum.reduce([across**2 + down**2, steps[0] ** 2, steps[1] ** 2])
    return squared


def most_of_texels(values: Floats, texel: int) -> Floats:
    """Return the greatest of (H, W) values in each square of `texel` pixels."""
    height, width = values.shape
    rows, columns = -(-height // texel), -(-width // texel)
    padded = np.full((rows * texel, columns * texel), -np.inf)
    padded[:height, :width] = values
    most: Floats = padded.reshape(rows, texel, columns, texel).max(axis=(1, 3))
    return most
