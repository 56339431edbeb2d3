"""Chapter 1's material for a path tracer, in float64: value, density and samples of `shaders/bsdf.glsl`.

Directions are local, the surface's normal is +z. Composed of the twins of the BRDF, of the environment's weights and
of the sampling of GGX, each written from its source. `table` (..., 3) are A, B, W for the direction of view, see
`tests/twins/shading_environment.py`. Everything broadcasts over leading axes.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from common.environment import Energy
from tests.twins import ggx_sampling, shading, shading_environment

Float64 = NDArray[np.float64]

UP = np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True)
class Material:
    """What a surface is made of; `table` belongs to one direction of view."""

    base_color: ArrayLike
    metallic: float
    roughness: float
    table: ArrayLike
    energy: Energy = "gltf"

    @property
    def alpha(self) -> float:
        """The width of the lobe, not below what shaders use."""
        return max(self.roughness**2, shading.ALPHA_MIN)

    def weights(self) -> tuple[Float64, Float64]:
        """Return the albedos of both lobes, the mirrored and the cosine."""
        return shading_environment.weights(self.base_color, self.metallic, self.table, self.energy)

    def specular(self) -> float:
        """Return the probability with which the mirrored lobe is chosen."""
        mirrored, even = (float(np.sum(w)) for w in self.weights())
        return mirrored / (mirrored + even) if mirrored + even > 0 else 1.0


def value(material: Material, l: ArrayLike, v: ArrayLike) -> Float64:  # noqa: E741
    """Return BRDF times cosine (..., 3) for light from `l` (..., 3) towards `v`."""
    metallic = material.metallic
    printed = shading.metallic_roughness(UP, l, v, material.base_color, metallic, material.alpha)
    if material.energy == "gltf":
        return printed
    cosine = np.maximum(np.asarray(l, np.float64)[..., 2:], 0)
    _, even = material.weights()
    if material.energy == "compensated":
        _, without = shading_environment.weights(material.base_color, metallic, material.table, "gltf")
        return printed + (even - without) / np.pi * cosine
    black = shading.metallic_roughness(UP, l, v, np.zeros(3), 0.0, material.alpha)
    metal = shading.metallic_roughness(UP, l, v, material.base_color, 1.0, material.alpha)
    return black * (1 - metallic) + metal * metallic + even / np.pi * cosine


def _above(v: ArrayLike) -> Float64:
    v = np.asarray(v, np.float64)
    return np.concatenate([v[..., :2], np.abs(v[..., 2:])], axis=-1)


def pdf(material: Material, l: ArrayLike, v: ArrayLike) -> Float64:  # noqa: E741
    """Return the density per solid angle of samples at `l` (..., 3), for the direction of view `v`."""
    l, above = np.asarray(l, np.float64), _above(v)  # noqa: E741
    h = l + above
    length = np.linalg.norm(h, axis=-1)
    n_dot_h = np.divide(h[..., 2], length, out=np.zeros(length.shape), where=length > 1e-6)
    mirrored = ggx_sampling.pdf_ggx(n_dot_h, above[..., 2], material.alpha)
    share = material.specular()
    return np.asarray(share * mirrored + (1 - share) * np.maximum(l[..., 2], 0) / np.pi)


def sample(material: Material, u: ArrayLike, v: ArrayLike) -> Float64:
    """Return directions of light (..., 3) for uniform numbers (..., 3); the first one chooses the lobe."""
    u, above = np.asarray(u, np.float64), _above(v)
    h = ggx_sampling.sample_ggx(u[..., 1:], above, material.alpha)
    mirrored = 2 * np.sum(above * h, axis=-1, keepdims=True) * h - above
    return np.where(u[..., :1] < material.specular(), mirrored, ggx_sampling.sample_cosine(u[..., 1:]))


def sphere(
    v: ArrayLike, alpha: float, panels: int = 40, nodes: int = 8, spokes: int = 96
) -> tuple[Float64, Float64]:
    """Return directions (N, 3) and weights (N,) that integrate over all l, by half vectors h of l and `v` (v.z >= 0).

    The slope of h runs from 1e-4 alpha to 1e4 by a constant factor in each panel, so lobes of any width are resolved,
    and the azimuth as far as `v` sees h. Light from below -v.z has h below the surface, where all densities are 0.
    """
    v = np.asarray(v, np.float64)
    x, weight = np.polynomial.legendre.leggauss(nodes)
    first, last_edge = np.log(alpha * 1e-4), np.log(1e4)
    # At the slope where mirrored light first dips below the horizon, values have a kink.
    dips = np.log(max(np.tan(0.5 * np.arcsin(np.clip(v[2], 0, 1))), 1e-300))
    part = int(np.clip(round(panels * (dips - first) / (last_edge - first)), 0, panels))
    if 0 < part < panels:
        edges = np.concatenate(
            [np.linspace(first, dips, part + 1), np.linspace(dips, last_edge, panels - part + 1)[1:]]
        )
    else:
        edges = np.linspace(first, last_edge, panels + 1)
    log_slope = (edges[:-1, None] + np.diff(edges)[:, None] * (x + 1) / 2).reshape(-1)
    log_weight = (np.diff(edges)[:, None] * weight / 2).reshape(-1)
    slope = np.exp(log_slope)
    n_dot_h = 1 / np.sqrt(1 + slope**2)
    # d(omega) = sin d(theta) d(phi), and d(theta) = d(ln slope) slope / (1 + slope^2).
    ring = slope * n_dot_h * slope * n_dot_h**2 * log_weight
    tilt = np.hypot(v[0], v[1]) * slope
    last = np.arccos(np.clip(-v[2] / np.maximum(tilt, 1e-300), -1, 1))
    x, weight = np.polynomial.legendre.leggauss(spokes)
    phi = last[:, None] * x
    around = phi + np.arctan2(v[1], v[0])
    sine = (slope * n_dot_h)[:, None]
    h = np.stack(
        [sine * np.cos(around), sine * np.sin(around), np.broadcast_to(n_dot_h[:, None], phi.shape)], -1
    )
    v_dot_h = h @ v
    l = 2 * v_dot_h[..., None] * h - v  # noqa: E741
    weights = ring[:, None] * last[:, None] * weight * 4 * np.maximum(v_dot_h, 0)
    return l.reshape(-1, 3), weights.reshape(-1)
