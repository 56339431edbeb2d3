"""Texels by lot in odd sizes and narrow formats, and the bytes of their rows: what copies in parts may get wrong."""

from __future__ import annotations

import numpy as np

from backends.gl.resources import FORMATS

ODD = [
    ("r8", (5, 3)),
    ("rg8", (7, 13)),
    ("rgba8", (33, 17)),
    ("rgba16f", (3, 9)),
    ("r8", (1, 1)),
    ("rgba8", (64, 1)),
]
"""(format, (width, height)); the longest row has 256 bytes."""


def rows_of(pixels: np.ndarray) -> np.ndarray:
    """Return the bytes (rows, bytes of a row) of pixels (H, W) or (H, W, C)."""
    return np.ascontiguousarray(pixels).view(np.uint8).reshape(pixels.shape[0], -1)


def random_pixels(format: str, size: tuple[int, int], seed: int = 0) -> np.ndarray:
    """Return pixels (H, W, C) of a format without blocks."""
    described = FORMATS[format]
    codes = np.random.default_rng(seed).integers(0, 256, (size[1], size[0], described.texel), np.uint8)
    if described.dtype is np.float16:
        codes[..., 1::2] &= 0x3F  # neither infinite nor negative
    return np.ascontiguousarray(codes).view(described.dtype).reshape(size[1], size[0], described.channels)
