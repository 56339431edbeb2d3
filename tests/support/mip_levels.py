"""The box filter between two mip levels of any size, in double precision: the truth for levels that a GPU makes."""

from __future__ import annotations

import numpy as np


def box(count: int, above: int) -> np.ndarray:
    """Return (count, above) weights of a box filter: how much of each source cell a target cell covers.

    Both rows of cells divide the same length; cells that are no multiple of each other overlap in part.
    """
    edges = np.arange(count + 1) * above / count
    low, high = (
        np.maximum.outer(edges[:-1], np.arange(above)),
        np.minimum.outer(edges[1:], np.arange(1, above + 1)),
    )
    return np.clip(high - low, 0, None) * count / above


def halved(texels: np.ndarray) -> np.ndarray:
    """Return the level below `texels` (H, W, C) float64."""
    height, width = texels.shape[:2]
    down, across = box(max(1, height // 2), height), box(max(1, width // 2), width)
    level: np.ndarray = np.einsum("yh,xw,hwc->yxc", down, across, texels)
    return level


def halved_codes(above: np.ndarray, srgb: bool = False) -> np.ndarray:
    """Return the level below 8-bit codes (H, W, C), not rounded; with `srgb` colour is averaged as light."""
    light = above / 255.0
    if not srgb:
        return 255.0 * halved(light)
    light[..., :3] = _light_of(light[..., :3])
    below = halved(light)
    below[..., :3] = _coded(below[..., :3])
    return 255.0 * below


def _light_of(coded: np.ndarray) -> np.ndarray:
    return np.where(coded <= 0.04045, coded / 12.92, ((coded + 0.055) / 1.055) ** 2.4)  # IEC 61966-2-1


def _coded(light: np.ndarray) -> np.ndarray:
    return np.where(light <= 0.0031308, light * 12.92, 1.055 * light ** (1 / 2.4) - 0.055)
