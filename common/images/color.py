"""Transfer functions between linear light and the coded values of files and displays.

The exact curve of sRGB (IEC 61966-2-1) has a straight piece near black; the power 2.2 is its well-known
approximation, off by up to 0.033 in coded values.
"""

from __future__ import annotations

from functools import cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

Float64 = NDArray[np.float64]

LUMINANCE = (0.2126, 0.7152, 0.0722)
"""Weights of linear red, green and blue in luminance (ITU-R BT.709, the primaries of sRGB)."""


def encode_srgb(linear: ArrayLike) -> Float64:
    """Return coded values of linear ones, exactly; negative values are mirrored, values above 1 go on."""
    linear = np.asarray(linear, np.float64)
    size = np.abs(linear)
    curve = 1.055 * np.maximum(size, 0.0031308) ** (1 / 2.4) - 0.055
    return np.copysign(np.where(size <= 0.0031308, 12.92 * size, curve), linear)


def decode_srgb(coded: ArrayLike) -> Float64:
    """Return linear values of coded ones: the inverse of `encode_srgb`."""
    coded = np.asarray(coded, np.float64)
    size = np.abs(coded)
    curve = ((size + 0.055) / 1.055) ** 2.4
    return np.copysign(np.where(size <= 0.04045, size / 12.92, curve), coded)


def encode_gamma(linear: ArrayLike) -> Float64:
    """Return linear ** (1 / 2.2), mirrored at 0."""
    linear = np.asarray(linear, np.float64)
    return np.copysign(np.abs(linear) ** (1 / 2.2), linear)


def decode_gamma(coded: ArrayLike) -> Float64:
    """Return coded ** 2.2, mirrored at 0."""
    coded = np.asarray(coded, np.float64)
    return np.copysign(np.abs(coded) ** 2.2, coded)


@cache
def srgb8_table() -> NDArray[np.float32]:
    """Return the linear values (256,) float32 of the coded bytes: `srgb8_table()[pixels]` decodes them."""
    table = decode_srgb(np.arange(256) / 255).astype(np.float32)
    table.flags.writeable = False
    return table


def quantize(values: ArrayLike, bits: int = 8) -> NDArray[np.uint8] | NDArray[np.uint16]:
    """Return values of 0..1 as unsigned integers of 8 or 16 bits, rounded to nearest; NaN becomes 0."""
    top = (1 << bits) - 1
    scaled = np.clip(np.nan_to_num(np.asarray(values, np.float64), nan=0.0), 0.0, 1.0) * top + 0.5
    return scaled.astype(np.uint8) if bits == 8 else scaled.astype(np.uint16)
