"""The shading functions of `shaders/` again, in float64 numpy: the truth that tests hold the GPU to.

Written from the definitions (glTF 2.0, appendix B; KHR_lights_punctual), not from the GLSL: where a shader takes a
detour for the sake of float32, this does not. Everything broadcasts over leading axes; vectors are (..., 3).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

Float64 = NDArray[np.float64]

ALPHA_MIN = 1e-3
"""The smallest alpha that shaders use; see `shaders/brdf.glsl`."""


def _dot(a: Float64, b: Float64) -> Float64:
    return np.asarray(np.einsum("...i,...i->...", a, b))


def distribution_ggx(n_dot_h: ArrayLike, alpha: ArrayLike) -> Float64:
    """Return the GGX distribution D in 1/sr, as the appendix prints it."""
    n_dot_h, alpha = np.asarray(n_dot_h, np.float64), np.asarray(alpha, np.float64)
    inner = n_dot_h**2 * (alpha**2 - 1.0) + 1.0
    return np.where(n_dot_h > 0, alpha**2 / (np.pi * inner**2), 0.0)


def visibility_ggx(n_dot_l: ArrayLike, n_dot_v: ArrayLike, alpha: ArrayLike) -> Float64:
    """Return the separable Smith visibility V = G / (4 |n.l| |n.v|) of the appendix."""
    a2 = np.asarray(alpha, np.float64) ** 2

    def side(cosine: ArrayLike) -> Float64:
        c = np.abs(np.asarray(cosine, np.float64))
        return np.asarray(c + np.sqrt(a2 + (1.0 - a2) * c**2))

    return 1.0 / (side(n_dot_l) * side(n_dot_v))


def metallic_roughness(
    n: ArrayLike,
    l: ArrayLike,  # noqa: E741
    v: ArrayLike,
    base_color: ArrayLike,
    metallic: ArrayLike,
    alpha: ArrayLike,
) -> Float64:
    """Return BRDF times n.l (..., 3); unit vectors, base colour (..., 3), metallic and alpha (...).

    n . h and |n x h| of a float64 h leave D with full precision down to alpha = 1e-3: the relative error of the printed
    denominator is 1e-16 / alpha^2.
    """
    n, l, v = (np.asarray(x, np.float64) for x in (n, l, v))  # noqa: E741
    base = np.asarray(base_color, np.float64)
    metal_part = np.asarray(metallic, np.float64)[..., None]
    alpha = np.asarray(alpha, np.float64)
    n_dot_l, n_dot_v = _dot(n, l), _dot(n, v)
    total = l + v
    length = np.linalg.norm(total, axis=-1, keepdims=True)
    h = np.divide(total, length, out=np.zeros_like(total), where=length > 0)
    weight = np.clip(1.0 - np.abs(_dot(h, v)), 0.0, 1.0)[..., None] ** 5
    specular = (visibility_ggx(n_dot_l, n_dot_v, alpha) * distribution_ggx(_dot(n, h), alpha))[..., None]
    fresnel = 0.04 + 0.96 * weight
    dielectric = base / np.pi * (1.0 - fresnel) + specular * fresnel
    metal = specular * (base + (1.0 - base) * weight)
    mixed = dielectric * (1.0 - metal_part) + metal * metal_part
    lit = (n_dot_l > 0) & (length[..., 0] ** 2 >= 1e-12)
    return np.where(lit[..., None], mixed * n_dot_l[..., None], 0.0)


def range_window(distance: ArrayLike, reach: ArrayLike) -> Float64:
    """Return glTF's window that takes a light to zero at its range `reach` (which may be infinite)."""
    ratio = np.asarray(distance, np.float64) / np.asarray(reach, np.float64)
    return np.clip(1.0 - ratio**4, 0.0, 1.0)


def spot_cone(cosine: ArrayLike, inner: float, outer: float) -> Float64:
    """Return glTF's cone factor for the cosine between axis and ray; half angles in radians."""
    scale = 1.0 / max(0.001, np.cos(inner) - np.cos(outer))
    return np.clip((np.asarray(cosine, np.float64) - np.cos(outer)) * scale, 0.0, 1.0) ** 2


def tone_neutral(color: ArrayLike) -> Float64:
    """Return the Khronos PBR Neutral tone curve (2024) of linear colours (..., 3)."""
    color = np.asarray(color, np.float64)
    start, desaturation = 0.8 - 0.04, 0.15
    darkest = color.min(axis=-1, keepdims=True)
    color = color - np.where(darkest < 0.08, darkest - 6.25 * darkest**2, 0.04)
    peak = color.max(axis=-1, keepdims=True)
    d = 1.0 - start
    with np.errstate(divide="ignore", invalid="ignore"):
        new_peak = 1.0 - d * d / (peak + d - start)
        squeezed = color * new_peak / peak
        gray = 1.0 - 1.0 / (desaturation * (peak - new_peak) + 1.0)
        bright = squeezed * (1.0 - gray) + new_peak * gray
    return np.where(peak < start, color, bright)
