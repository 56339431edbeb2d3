"""Densities of the directions in which a path goes on from a surface, in the plane of view and normal."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tools.site.figures.canvas import Canvas
from tools.site.figures.charts import Axis, Curve, curves

Float64 = NDArray[np.float64]

ROUGHNESS, BASE, F0 = 0.5, 0.5, 0.04
"""Of a dielectric surface, grey."""
VIEW = 55.0
"""Degrees between the direction to the eye and the normal."""


def towards(angle: Float64) -> Float64:
    """Return directions in the plane of view and normal, by degrees from the normal; the eye has negative ones."""
    radians = np.radians(angle)
    return np.stack([np.sin(radians), np.zeros_like(radians), np.cos(radians)], axis=-1)


def parts(light: Float64) -> tuple[Float64, Float64, Float64, Float64]:
    """Return BRDF times cosine of the mirrored and of the matte part, and the densities of both lobes, of (..., 3).

    The material is that of chapter 1, and the mirrored lobe has the density of visible normals (Heitz 2018).
    """
    view, alpha2 = towards(np.array(-VIEW)), ROUGHNESS**4
    half = light + view
    half /= np.linalg.norm(half, axis=-1, keepdims=True)
    n_dot_l, n_dot_h, n_dot_v = light[..., 2], half[..., 2], float(view[2])
    d = alpha2 / (np.pi * (n_dot_h**2 * (alpha2 - 1.0) + 1.0) ** 2)
    to_v, to_l = (np.sqrt(alpha2 + (1.0 - alpha2) * x * x) for x in (n_dot_v, n_dot_l))
    visible = 1.0 / ((n_dot_l + to_l) * (n_dot_v + to_v))
    fresnel = F0 + (1.0 - F0) * (1.0 - half @ view) ** 5
    g1 = 2.0 * n_dot_v / (n_dot_v + to_v)
    cosine = n_dot_l / np.pi
    return fresnel * d * visible * n_dot_l, (1.0 - fresnel) * BASE * cosine, g1 * d / (4.0 * n_dot_v), cosine


def hemisphere(count: int = 600) -> tuple[Float64, float]:
    """Return directions over the hemisphere, and the solid angle of each."""
    z = (np.arange(count) + 0.5) / count
    phi = (np.arange(2 * count) + 0.5) * np.pi / count
    sine = np.sqrt(1.0 - z * z)[:, None]
    shape = count, 2 * count
    directions = np.stack(
        [sine * np.cos(phi), sine * np.sin(phi), np.broadcast_to(z[:, None], shape)], axis=-1
    )
    return directions, np.pi / count**2


def albedos() -> tuple[float, float]:
    """Return the light that each part reflects of even light."""
    directions, angle = hemisphere()
    mirrored, matte, _, _ = parts(directions)
    return float(mirrored.sum() * angle), float(matte.sum() * angle)


def densities_of_lobes() -> Canvas:
    """What is reflected, beside both lobes and their mixture."""
    angle = np.linspace(-88.0, 88.0, 177)
    mirrored, matte, lobe, cosine = parts(towards(angle))
    both = sum(albedos())
    share = albedos()[0] / both
    shown = {
        "what is reflected": (mirrored + matte) / both,
        "the mirrored lobe": lobe,
        "the cosine lobe": cosine,
        "both, by their albedos": share * lobe + (1.0 - share) * cosine,
    }
    return curves(
        "Densities of directions in which a path goes on",
        Axis("degrees from the normal, away from the eye", begin=-100.0),
        Axis("density per steradian", log=True),
        [
            Curve(name, list(zip(angle.tolist(), values.tolist(), strict=True)), name[0] == "w", marks=False)
            for name, values in shown.items()
        ],
        f"A grey dielectric of roughness {ROUGHNESS:g}, seen at {VIEW:g}°; {100 * share:.0f} % go to the mirrored lobe",
    )
