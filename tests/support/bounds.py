"""What graphics hardware may do where it is free to: bounds from its specifications, for tests on a GPU."""

from __future__ import annotations

from typing import Any

import numpy as np

from backends.gl.driver.capabilities import integer
from common.images.color import decode_srgb


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


def codes_off(device: Any) -> float:
    """Return how far, in codes, a stored 8-bit code may lie from the value that a shader or a clear gave, unrounded.

    Half a code where values are rounded to the nearest, as the software driver does. Vulkan and OpenGL only ask for
    that, and graphics hardware has the tolerance of Direct3D 11 for what is written as UNORM, plain or sRGB: 0.6
    (D3D11_FLOAT32_TO_INTEGER_TOLERANCE_IN_ULP). An H200 was 0.56 off in sRGB.
    """
    return 0.5 if device.capabilities.is_software else 0.6


def snapping(device: Any) -> float:
    """Return how far, in pixels, a device may move a vertex before it fills the triangle.

    Hardware snaps vertices to its sub-pixel grid, along each axis to within 0.6 of a step (Direct3D 11's tolerance of
    such roundings; 0.48 was measured on an H200), and then interpolates: depth is off by as much of its slope. The
    software driver takes depth from where the vertex was.
    """
    if device.capabilities.is_software:
        return 0.0
    if device.capabilities.backend == "gl":
        bits = integer(device.fn, GL_SUBPIXEL_BITS)
    else:
        bits = device.limits.subPixelPrecisionBits
    return 0.6 * 2.0**-bits


GL_SUBPIXEL_BITS = 0x0D50

LEAST_LEVEL_BITS = 4
"""The least that Vulkan requires of mipmapPrecisionBits; OpenGL requires and tells nothing."""


def level_step(device: Any, given_gradients: bool = False) -> float:
    """Return how far, in levels, a device may be from a level of detail that is a multiple of 1/4.

    Hardware snaps levels to steps of 2^-bits (VkPhysicalDeviceLimits::mipmapPrecisionBits), and a level that is less
    than a multiple by its rounding may go a whole step down. With gradients that a shader gives (textureGrad) the unit
    itself takes their logarithm, for which nothing is stated: the largest step that Vulkan allows has to hold it. An
    H100 was 0.003 off between fragments and 0.012 with given gradients.

    The software driver is exact, but for llvmpipe's logarithm of given gradients: it squares them and reads log2 of
    2^n (1 + m) as n + m. Half of that is off by up to 0.0430, and by 0 at whole levels.
    """
    if device.capabilities.is_software:
        return 0.0431 if given_gradients and device.capabilities.backend == "gl" else 0.0
    if given_gradients or device.capabilities.backend == "gl":
        return float(2.0**-LEAST_LEVEL_BITS)
    return float(2.0**-device.limits.mipmapPrecisionBits)
