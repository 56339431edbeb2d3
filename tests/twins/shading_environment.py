"""How much of an environment's light a surface reflects: quadratures of the BRDF in float64, and the split sum again.

In light that is the same from everywhere, glTF's metallic-roughness BRDF needs three numbers besides the colour:

    A, B   the specular part, split by Schlick's Fresnel F = F0 (1 - w) + w with w = (1 - v.h)^5:
           F0 A + B is its directional albedo (Karis 2013, "Real Shading in Unreal Engine 4")
    W      the mean of w over cosine-weighted light: what Fresnel takes from the diffuse part

`shaders/ibl.glsl` has `weights` in GLSL. Everything broadcasts over leading axes.
"""

from __future__ import annotations

from functools import cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from common.environment import Energy
from tests.twins.shading import visibility_ggx

Float64 = NDArray[np.float64]

DIELECTRIC = 0.04
"""Reflectance of a dielectric at normal incidence (glTF 2.0: index of refraction 1.5)."""


@cache
def _nodes(count: int) -> tuple[Float64, Float64]:
    """Return places from -1 to 1 and weights of Gauss and Legendre's rule."""
    x, weight = np.polynomial.legendre.leggauss(count)
    return x, weight


def specular_albedo(n_dot_v: ArrayLike, alpha: ArrayLike, nodes: int = 96) -> tuple[Float64, Float64]:
    """Return A and B by quadrature over half vectors h; error below 1e-4 with the default number of nodes.

    With tan^2 of h's angle = alpha^2 t / (1 - t), D (n.h) dh is dt dphi / (2 pi) exactly: the peak of D is gone however
    narrow it is, and dl = 4 (v.h) dh. Light is above the horizon for azimuths below a limit, all of them up to some t;
    pieces end there, so that each is smooth. No sampler is involved that a shader uses.
    """
    n_dot_v, alpha = np.broadcast_arrays(np.asarray(n_dot_v, np.float64), np.asarray(alpha, np.float64))
    a, b = np.zeros(n_dot_v.shape), np.zeros(n_dot_v.shape)
    for place in np.ndindex(n_dot_v.shape):  # one at a time: the grid of nodes is large enough
        a[place], b[place] = _specular_albedo(float(n_dot_v[place]), float(alpha[place]), nodes)
    return a, b


def _specular_albedo(cosine: float, alpha: float, nodes: int) -> tuple[float, float]:
    sine = np.sqrt(max(1 - cosine**2, 0.0))
    # Where mirrored light first dips below the horizon: h's angle is half of what is left between v and the horizon.
    slope2 = np.tan(0.5 * (np.pi / 2 - np.arccos(cosine))) ** 2
    first = slope2 / (alpha**2 + slope2)
    x, weight = _nodes(nodes)
    x, weight = (x + 1) / 2, weight / 2
    grade, grade_weight = (
        x**2 * (3 - 2 * x),
        weight * 6 * x * (1 - x),
    )  # denser at both ends, where roots begin
    a = b = 0.0
    for start, end in ((0.0, first), (first, 1.0)):
        t = start + (end - start) * grade[:, None]
        n_dot_h = np.sqrt((1 - t) / (1 - t + alpha**2 * t))
        h_sine = np.sqrt(np.maximum(1 - n_dot_h**2, 0))
        double = 2 * h_sine * n_dot_h * sine
        limit = cosine * (1 - 2 * n_dot_h**2)
        ratio = np.divide(limit, double, out=np.full(t.shape, -1.0), where=double > 0)
        last = np.arccos(np.clip(ratio, -1, 1))
        phi = last * grade[None, :]
        v_dot_h = sine * h_sine * np.cos(phi) + cosine * n_dot_h
        n_dot_l = np.maximum(2 * v_dot_h * n_dot_h - cosine, 0)
        with np.errstate(divide="ignore", invalid="ignore"):
            part = visibility_ggx(n_dot_l, cosine, alpha) * n_dot_l * 4 * v_dot_h / n_dot_h
        part = (
            np.where(n_dot_l > 0, part, 0)
            * last
            / np.pi
            * np.outer(grade_weight, grade_weight)
            * (end - start)
        )
        w = (1 - np.clip(v_dot_h, 0, 1)) ** 5
        a, b = a + float((part * (1 - w)).sum()), b + float((part * w).sum())
    return a, b


def fresnel_share(n_dot_v: ArrayLike, nodes: int = 200) -> Float64:
    """Return W, the mean of (1 - v.h)^5 over light with the density cosine / pi, by quadrature."""
    n_dot_v = np.asarray(n_dot_v, np.float64)[..., None, None]
    x, weight = _nodes(nodes)
    n_dot_l, phi = ((x + 1) / 2)[:, None], ((x + 1) * (np.pi / 2))[None, :]
    v_dot_l = np.sqrt(1 - n_dot_v**2) * np.sqrt(1 - n_dot_l**2) * np.cos(phi) + n_dot_v * n_dot_l
    v_dot_h = np.sqrt(np.clip((1 + v_dot_l) / 2, 0, 1))
    return np.asarray(((1 - v_dot_h) ** 5 * n_dot_l * np.outer(weight, weight) / 2).sum(axis=(-2, -1)))


def albedo_table(n_dot_v: ArrayLike, roughness: ArrayLike) -> Float64:
    """Return (..., 3): A, B and W for cosines and roughness (alpha is its square), by quadrature."""
    n_dot_v, roughness = np.broadcast_arrays(
        np.asarray(n_dot_v, np.float64), np.asarray(roughness, np.float64)
    )
    a, b = specular_albedo(n_dot_v, roughness**2)
    return np.stack([a, b, fresnel_share(n_dot_v)], axis=-1)


def weights(
    base_color: ArrayLike, metallic: ArrayLike, table: ArrayLike, energy: Energy
) -> tuple[Float64, Float64]:
    """Return what the mirrored radiance, and the irradiance / pi, are multiplied by: two arrays (..., 3).

    `base_color` (..., 3), `metallic` (...), `table` (..., 3) of A, B, W. "gltf" is the BRDF as printed; "compensated"
    adds the light that bounces between facets (Fdez-Aguera 2019, "A Multiple-Scattering Microfacet Model for Real-Time
    Image-based Lighting"); "conserving" also gives the diffuse part only what the specular part leaves.
    """
    base = np.asarray(base_color, np.float64)
    metal = np.asarray(metallic, np.float64)[..., None]
    table = np.asarray(table, np.float64)
    a, b, w = table[..., 0:1], table[..., 1:2], table[..., 2:3]

    def specular(f0: Float64) -> tuple[Float64, Float64]:
        single = f0 * a + b
        if energy == "gltf":
            return single, np.zeros_like(single)
        lost = 1 - a - b
        mean = f0 + (1 - f0) / 21  # Schlick's Fresnel averaged over the hemisphere
        return single, lost * single * mean / (1 - mean * lost)

    once, more = specular(np.full_like(base, DIELECTRIC))
    left = 1 - once - more if energy == "conserving" else (1 - DIELECTRIC) * (1 - w)
    metal_once, metal_more = specular(base)
    on_radiance = once * (1 - metal) + metal_once * metal
    on_irradiance = (base * left + more) * (1 - metal) + metal_more * metal
    return on_radiance, on_irradiance


def split_sum_fit(n_dot_v: ArrayLike, roughness: ArrayLike) -> tuple[Float64, Float64]:
    """Return A and B by the fit of Karis 2014 ("Physically Based Shading on Mobile"), cut where it is below 0."""
    n_dot_v, roughness = np.asarray(n_dot_v, np.float64), np.asarray(roughness, np.float64)
    x, y, z, w = (
        slope * roughness + start
        for slope, start in ((-1, 1), (-0.0275, 0.0425), (-0.572, 1.04), (0.022, -0.04))
    )
    p = np.minimum(x * x, 2.0 ** (-9.28 * n_dot_v)) * x + y
    return np.maximum(-1.04 * p + z, 0.0), np.maximum(1.04 * p + w, 0.0)
