"""Mip chains made on the CPU, before a scene is cached: the box filter of `shaders/mips.comp`, in numpy.

A target texel covers 2 source texels of each axis where the source is even, and 2 + 1/n where it is odd (n texels in
the target); colour that is sRGB-coded is averaged as light. Each level is made from the rounded one above it, as on the
GPU, from which it differs by at most one code.
"""

from __future__ import annotations

from functools import cache

import numpy as np
from numpy.typing import NDArray

from common.images.color import encode_srgb, srgb8_table

Bytes = NDArray[np.uint8]
Float32 = NDArray[np.float32]

_LIGHT = 65535
"""Steps of linear light: near black, where the curve is steepest, 20 of them are one sRGB code."""


def mip_chain(pixels: Bytes, srgb: bool) -> tuple[Bytes, ...]:
    """Return all levels of `pixels` (H, W, C) uint8 down to 1x1, `pixels` itself first.

    `srgb` says that the first three channels are sRGB codes; a fourth one, alpha, is averaged as it is.
    """
    levels = [np.ascontiguousarray(pixels)]
    while max(levels[-1].shape[:2]) > 1:
        levels.append(halved(levels[-1], srgb))
    return tuple(levels)


def halved(pixels: Bytes, srgb: bool) -> Bytes:
    """Return the level below `pixels` (H, W, C) uint8: (max(1, H // 2), max(1, W // 2), C)."""
    height, width, channels = pixels.shape
    below = np.empty((max(1, height // 2), max(1, width // 2), channels), np.uint8)
    # Channel by channel: numpy's inner loops then run over rows and not over the few channels of a texel.
    for channel in range(channels):
        values = pixels[..., channel]
        if srgb and channel < 3:
            np.take(_code_of_light(), _mean(np.take(_light_of_code(), values)), out=below[..., channel])
        else:
            below[..., channel] = _mean(values)
    return below


def _mean(values: NDArray[np.uint8] | NDArray[np.uint16]) -> NDArray[np.uint16]:
    """Return what the box filter makes of (H, W) integers, rounded to integers."""
    height, width = values.shape[:2]
    if height % 2 or width % 2:
        return np.rint(_along(_along(values.astype(np.float32)).T).T).astype(np.uint16)
    wide: type[np.uint16] | type[np.uint32] = np.uint16 if values.dtype == np.uint8 else np.uint32
    down = np.add(values[0::2], values[1::2], dtype=wide)
    total = down[:, 0::2] + down[:, 1::2]
    # To the nearest, of two equally near to the even one, as roundEven does in the shader.
    return ((total + 1 + ((total >> 2) & 1)) >> 2).astype(np.uint16)


def _along(values: Float32) -> Float32:
    """Return (N, M) values filtered along the first axis."""
    source = len(values)
    if source == 1:
        return values
    if source % 2 == 0:
        return (values[0::2] + values[1::2]) * np.float32(0.5)
    n = source // 2
    place = np.arange(n, dtype=np.float32)[:, None]
    total = np.float32(2 * n + 1)
    return (
        values[0:-1:2] * ((n - place) / total)
        + values[1::2] * (np.float32(n) / total)
        + values[2::2] * ((place + 1) / total)
    )


@cache
def _light_of_code() -> NDArray[np.uint16]:
    """Return the light (256,) of each sRGB code, in steps."""
    return np.rint(srgb8_table().astype(np.float64) * _LIGHT).astype(np.uint16)


@cache
def _code_of_light() -> Bytes:
    """Return the nearest sRGB code of each step of light."""
    return np.rint(encode_srgb(np.arange(_LIGHT + 1) / _LIGHT) * 255).astype(np.uint8)
