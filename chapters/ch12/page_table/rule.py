"""The resolution of shadow maps that a picture asks for, and which lights matter most in it. No device.

A cluster of the picture that covers `pixels` pixels, seen from a light within a solid angle of Omega, needs as many
texels there as it has pixels: a cube with 6 faces of n x n texels has 6 n^2 / (4 pi) of them for each steradian, so
n = sqrt(4 pi pixels / (6 Omega)). A sphere of radius r at distance d has Omega = 2 pi (1 - sqrt(d^2 - r^2) / d).

Source: Olsson et al., "Efficient Virtual Shadow Maps for Many Lights", I3D 2014, section 3.2.

For clusters that shrink to points, the formula tends to a distance from the light over a distance from the eye:
a pixel of p radians at depth z has an area of (p z)^2, which is (p z / rho)^2 steradians at distance rho from a light.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from common.view.camera import Orthographic, View

Float64 = NDArray[np.float64]

TEXELS = float(np.sqrt(4 * np.pi / 6))
"""Texels along a face of a cube, for one texel in each steradian."""

NEAREST = 0.05
"""The least distance from the eye at which a light is asked for texels, in parts of its reach."""


def solid_angle(distance: ArrayLike, radius: ArrayLike) -> Float64:
    """Return the steradians that a sphere covers from a point at a distance; 4 pi inside of it."""
    away, size = np.asarray(distance, np.float64), np.asarray(radius, np.float64)
    with np.errstate(invalid="ignore", divide="ignore"):
        outside = 2 * np.pi * (1 - np.sqrt(away**2 - size**2) / away)
    covered: Float64 = np.where(away > size, outside, 4 * np.pi)
    return covered


def cluster_resolution(distance: ArrayLike, radius: ArrayLike, pixels: float, most: float) -> Float64:
    """Return the texels along a face that a cluster asks of a light; `most` where the light is inside."""
    inside = np.asarray(distance) <= np.asarray(radius)
    resolution: Float64 = np.sqrt(4 * np.pi * pixels / (6 * solid_angle(distance, radius)))
    return np.where(inside, most, np.minimum(resolution, most))


def cluster_boxes(view: View, aspect: float, tiles: tuple[int, int], slices: int, far: float) -> Float64:
    """Return the boxes (slices, rows, columns, 2, 3) around the clusters of a perspective view, in view space.

    Slices end at n (f/n)^(k / slices) metres ahead of the camera, so all are of one shape.
    """
    assert not isinstance(view.projection, Orthographic), "logarithmic slices need a perspective"
    near = view.projection.near
    ends = near * (far / near) ** (np.arange(slices + 1) / slices)
    up = np.tan(view.projection.yfov / 2)
    x = np.linspace(-1, 1, tiles[0] + 1) * up * aspect
    y = np.linspace(1, -1, tiles[1] + 1) * up
    depth = np.stack([ends[:-1], ends[1:]], axis=1)  # (slices, 2)
    boxes = np.empty((slices, tiles[1], tiles[0], 2, 3))
    for axis, edge in enumerate((x, y)):
        products = (
            depth[:, :, None, None] * np.stack([edge[:-1], edge[1:]])[None, None]
        )  # slice, end, side, tile
        low, high = products.min(axis=(1, 2)), products.max(axis=(1, 2))
        shape = (slices, 1, -1) if axis == 0 else (slices, -1, 1)
        boxes[..., 0, axis], boxes[..., 1, axis] = low.reshape(shape), high.reshape(shape)
    boxes[..., 0, 2], boxes[..., 1, 2] = (-ends[1:])[:, None, None], (-ends[:-1])[:, None, None]
    return boxes


def seen(view: View, aspect: float, centres: Float64, radii: Float64) -> NDArray[np.bool_]:
    """Return (N,) whether spheres with world-space `centres` (N, 3) may reach into the view."""
    in_view = (centres - view.eye) @ view.world_from_view[:3, :3]
    ahead = -in_view[:, 2]
    lens = view.projection
    if isinstance(lens, Orthographic):
        half = np.array([lens.ymag * aspect, lens.ymag])
        outside = (np.abs(in_view[:, :2]) - half > radii[:, None]).any(axis=1)
        return ~(outside | (ahead + radii < lens.near) | (ahead - radii > lens.far))
    half = np.arctan(np.tan(lens.yfov / 2) * np.array([aspect, 1.0]))
    beyond = np.abs(in_view[:, :2]) * np.cos(half) - ahead[:, None] * np.sin(half)
    return ~((beyond > radii[:, None]).any(axis=1) | (ahead + radii < 0))


def importance(view: View, aspect: float, centres: Float64, radii: Float64, peaks: Float64) -> Float64:
    """Return (N,) how much lights matter: mean illuminance times their share of the picture, 0 if they are not seen."""
    away = np.linalg.norm(centres - view.eye, axis=1)
    if isinstance(view.projection, Orthographic):
        away = np.zeros_like(away)
    return np.where(seen(view, aspect, centres, radii), peaks / np.maximum(away, radii) ** 2, 0.0)


def resolutions(view: View, rows: int, centres: Float64, radii: Float64) -> Float64:
    """Return (N,) texels along a face for one texel in each pixel, in a picture of `rows` rows.

    It is the bound of `cluster_resolution` over all clusters that a light's sphere covers: where the sphere comes
    nearest to the camera, at its whole radius from the light.
    """
    lens = view.projection
    if isinstance(lens, Orthographic):
        return TEXELS * radii * rows / (2 * lens.ymag)
    ahead = (view.eye - centres) @ view.world_from_view[:3, 2]
    nearest = np.maximum(ahead - radii, np.maximum(lens.near, NEAREST * radii))
    return TEXELS * radii / nearest * rows / (2 * np.tan(lens.yfov / 2))
