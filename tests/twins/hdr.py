"""Exposure, adaptation, bloom and tone curves in float64, from their definitions."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

Float64 = NDArray[np.float64]

REC_709 = np.array([0.2126, 0.7152, 0.0722])


def luminance(rgb: ArrayLike) -> Float64:
    """Return the luminance (...) of linear colours (..., 3)."""
    return np.asarray(np.asarray(rgb, np.float64) @ REC_709)


def log_average(nits: ArrayLike, low: float, high: float) -> float:
    """Return the mean log2 of the luminances between two shares of the pixels in order of luminance."""
    values = np.sort(np.log2(np.asarray(nits, np.float64).ravel()))
    number = np.arange(len(values))
    first, end = low * len(values), high * len(values)
    weights = np.clip(np.minimum(number + 1, end) - np.maximum(number, first), 0.0, None)
    return float((weights * values).sum() / weights.sum())


def box_reduced(image: Float64, side: int) -> Float64:
    """Return (side, side) means of an image (H, W) over equal areas, with parts of pixels."""

    def weights(size: int) -> Float64:
        edges = np.arange(side + 1) * size / side
        pixels = np.arange(size)
        high = np.minimum(edges[1:, None], pixels + 1)
        return np.clip(high - np.maximum(edges[:-1, None], pixels), 0.0, None) * side / size

    height, width = image.shape
    return np.asarray(weights(height) @ image @ weights(width).T)


def bright_part(color: ArrayLike, threshold: float) -> Float64:
    """Return colours (..., 3) with the largest channel reduced by the threshold, and the others in proportion."""
    color = np.asarray(color, np.float64)
    peak = color.max(-1, keepdims=True)
    return np.asarray(color * np.clip(peak - threshold, 0.0, None) / np.maximum(peak, 1e-300))


def _along(image: Float64, axis: int, count: int, taps: ArrayLike, first: int, step: float) -> Float64:
    """Return `count` sums over `taps` along an axis; sum number i begins at first + step i, clamped to the edge."""
    size = image.shape[axis]
    total = 0.0
    for number, weight in enumerate(np.asarray(taps)):
        places = np.clip((np.arange(count) * step).astype(int) + first + number, 0, size - 1)
        total = total + weight * np.take(image, places, axis)
    return np.asarray(total)


def halved(image: Float64, shape: tuple[int, int]) -> Float64:
    """Return an image (H, W, C) at `shape`, about half the size, by weights 1, 3, 3, 1 of 8 along each axis."""
    for axis in (0, 1):
        image = _along(image, axis, shape[axis], np.array([1, 3, 3, 1]) / 8, -1, 2)
    return image


def enlarged(image: Float64, shape: tuple[int, int]) -> Float64:
    """Return an image (H, W, C) at about twice the size, bilinear."""
    for axis in (0, 1):
        fine = np.arange(shape[axis])
        place = (fine + 0.5) / 2 - 0.5
        below = np.floor(place).astype(int)
        part = (place - below).reshape((-1, 1, 1) if axis == 0 else (1, -1, 1))
        size = image.shape[axis]
        low, high = (np.take(image, np.clip(below + step, 0, size - 1), axis) for step in (0, 1))
        image = low * (1 - part) + high * part
    return image


def bloomed(image: Float64, strength: float, threshold: float, levels: int) -> Float64:
    """Return a picture (H, W, 3) in which a part of the bright light is the mean of `levels` wider pictures of it."""
    bright = bright_part(image, threshold)
    pyramid = [bright]
    for level in range(1, levels + 1):
        rows, columns = (max(1, round(size * 0.5**level)) for size in image.shape[:2])
        pyramid.append(halved(pyramid[-1], (rows, columns)))
    wide = pyramid[-1]
    for number, level in enumerate(reversed(pyramid[1:-1]), start=1):
        larger = enlarged(wide, level.shape[:2])
        wide = (larger * number + level) / (number + 1)
    return image + strength * (enlarged(wide, image.shape[:2]) - bright)


def tone_reinhard(color: ArrayLike, white: float) -> Float64:
    """Return Reinhard's curve with a white point, of each channel, at most 1."""
    color = np.asarray(color, np.float64)
    return np.asarray(np.where(color < white, color * (1 + color / white**2) / (1 + color), 1.0))


def tone_aces(color: ArrayLike) -> Float64:
    """Return Narkowicz's fit of each channel, from 0 to 1."""
    x = np.asarray(color, np.float64)
    return np.clip((x * (2.51 * x + 0.03)) / (x * (2.43 * x + 0.59) + 0.14), 0.0, 1.0)
