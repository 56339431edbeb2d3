"""What graphics hardware may do where it is free to: bounds from its specifications, for tests on a GPU."""

from __future__ import annotations

import numpy as np

from common.color import decode_srgb


def decoded_srgb(codes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the least and the most light, float64, that a texture unit may make of 8-bit sRGB codes.

    Vulkan and OpenGL name the curve and no precision; Direct3D 11, for which the same units are built, lets a decoded
    value be half a code from its own on the coded side (D3D11_SRGB_TO_FLOAT_TOLERANCE_IN_ULP), so that encoding leads
    back to the code. The ends are exact. An H200 keeps seven or eight bits of a value: 0.43 of a code at most, 0.5 % of
    the light.
    """
    coded = codes.astype(np.float64)
    low = np.where(codes == 255, 255.0, np.maximum(coded - 0.5, 0.0))
    high = np.where(codes == 0, 0.0, np.minimum(coded + 0.5, 255.0))
    return decode_srgb(low / 255), decode_srgb(high / 255)
