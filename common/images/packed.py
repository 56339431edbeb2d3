"""Formats whose channels share a word: their values as numbers."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray


def unpacked(pixels: NDArray[Any], format: str) -> NDArray[Any]:
    """Return pixels as they are stored, (H, W) words, as (H, W, C) numbers; those of other formats as they are.

    "rgb10a2": three channels of 10 bits and one of 2, red in the lowest bits, all of them from 0 to 1 (Vulkan
    specification, VK_FORMAT_A2B10G10R10_UNORM_PACK32; OpenGL's GL_UNSIGNED_INT_2_10_10_10_REV).
    """
    if format != "rgb10a2":
        return pixels
    shifts, codes = np.array((0, 10, 20, 30), np.uint32), np.array((1023, 1023, 1023, 3), np.uint32)
    return ((pixels[..., None] >> shifts & codes) / codes).astype(np.float32)
