"""Sampling of the GGX distribution and of the cosine: `shaders/ggx_sampling.glsl` again, in float64.

Directions are local: the surface's normal is +z. Everything broadcasts over leading axes.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tests.twins.shading import distribution_ggx

Float64 = NDArray[np.float64]


def frame_around(n: ArrayLike) -> Float64:
    """Return (..., 3, 3) rotations whose columns are two tangents and unit `n` (..., 3) (Duff et al. 2017)."""
    n = np.asarray(n, np.float64)
    x, y, z = n[..., 0], n[..., 1], n[..., 2]
    s = np.where(z < 0, -1.0, 1.0)
    a = -1.0 / (s + z)
    b = x * y * a
    return np.stack(
        [
            np.stack([1 + s * x * x * a, b, x], axis=-1),
            np.stack([s * b, s + y * y * a, y], axis=-1),
            np.stack([-s * x, -y, z], axis=-1),
        ],
        axis=-2,
    )


def sample_cosine(u: ArrayLike) -> Float64:
    """Return directions (..., 3) with the density cosine / pi, of uniform numbers (..., 2)."""
    u = np.asarray(u, np.float64)
    phi, r = 2 * np.pi * u[..., 0], np.sqrt(u[..., 1])
    return np.stack([r * np.cos(phi), r * np.sin(phi), np.sqrt(1 - u[..., 1])], axis=-1)


def sample_ggx(u: ArrayLike, v: ArrayLike, alpha: ArrayLike) -> Float64:
    """Return microfacet normals (..., 3) with the density by which `v` (..., 3) sees them.

    The density is G1(v) max(v.h, 0) D(h) / v.z per solid angle (Heitz 2018); the way is that of Dupuy and Benyoub 2023.
    """
    u, v, alpha = (np.asarray(x, np.float64) for x in (u, v, alpha))
    squeeze = np.stack(np.broadcast_arrays(alpha, alpha, 1.0), axis=-1)
    stretched = v * squeeze
    stretched = stretched / np.linalg.norm(stretched, axis=-1, keepdims=True)
    phi = 2 * np.pi * u[..., 0]
    z = (1 - u[..., 1]) * (1 + stretched[..., 2]) - stretched[..., 2]
    r = np.sqrt(np.clip(1 - z * z, 0, 1))
    h = (np.stack([r * np.cos(phi), r * np.sin(phi), z], axis=-1) + stretched) * squeeze
    h[..., 2] = np.maximum(h[..., 2], 0)
    return np.asarray(h / np.linalg.norm(h, axis=-1, keepdims=True))


def masking_ggx(cosine: ArrayLike, alpha: ArrayLike) -> Float64:
    """Return Smith's G1 for cosines >= 0: the part of the facets that is not behind others."""
    cosine, a2 = np.asarray(cosine, np.float64), np.asarray(alpha, np.float64) ** 2
    total = cosine + np.sqrt(a2 + (1 - a2) * cosine**2)
    return np.divide(2 * cosine, total, out=np.zeros(np.shape(total)), where=total > 0)


def pdf_ggx(n_dot_h: ArrayLike, n_dot_v: ArrayLike, alpha: ArrayLike) -> Float64:
    """Return the density per solid angle of v mirrored at an h of `sample_ggx`: G1(v) D(h) / (4 n.v)."""
    v, a2 = np.asarray(n_dot_v, np.float64), np.asarray(alpha, np.float64) ** 2
    return 0.5 * distribution_ggx(n_dot_h, alpha) / (v + np.sqrt(a2 + (1 - a2) * v**2))
