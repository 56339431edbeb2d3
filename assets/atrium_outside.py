"""What lies outside the atrium: the garden that its portal shows, a meadow around it, and an evening sky over all."""

from __future__ import annotations

import numpy as np

from assets.atrium_building import GALLERY, HALF_X, HALF_Z, WALL
from assets.gltf_writer import GltfBuilder
from assets.noise import Float64
from assets.shapes import Mesh, quad, surface

RADIUS = 22.0  # metres to the sky: no more than the camera above the roof needs, since bounds follow from it
SEGMENTS, RINGS = 24, 6  # of the dome
EDGE = 1 / 128  # what is left out at the sky picture's top and bottom: where it repeats, filters mix the two
MEADOW = 1 / 8  # repeats per metre
AWAY = HALF_X + GALLERY + WALL  # outside of the east wall

BACKDROP = {"strata": {"backdrop": True}}
"""Marks a picture of something far away, already lit: it casts no shadow, and no light falls on it or comes from it."""


def add_outside(scene: GltfBuilder, material: dict[str, int]) -> None:
    """Add garden, path, meadow and sky."""
    outside = scene.add_node("outside")
    garden = quad((AWAY + 4.0, 4.6, -3.6), (0, 0, 7.2), (0, -4.6, 0)).with_uv((1 / 7.2, 1 / 4.6))
    mesh = scene.add_mesh("garden", (garden, material["garden_backdrop"]))
    scene.add_node("garden", outside, mesh=mesh, extras=BACKDROP)
    scene.add_node("garden_path", outside, mesh=scene.add_mesh("garden_path", (_path(), material["gravel"])))
    scene.add_node("meadow", outside, mesh=scene.add_mesh("meadow", (_meadow(), material["meadow"])))
    mesh = scene.add_mesh("sky", (_sky(), material["sky_backdrop"]))
    scene.add_node("sky", outside, mesh=mesh, extras=BACKDROP)


def _azimuths() -> tuple[Float64, Float64]:
    """Return x and z (SEGMENTS + 1,) of a unit circle that runs to the right for someone who stands in it."""
    around = np.linspace(0.0, 2 * np.pi, SEGMENTS + 1)
    x, z = -np.sin(around), np.cos(around)
    x[-1], z[-1] = x[0], z[0]
    return x, z


def _sky() -> Mesh:
    """Return half a sphere seen from inside; its picture goes around twice."""
    x, z = _azimuths()
    elevation = np.radians(np.linspace(90.0, 0.0, RINGS + 1))[:, None]
    across, up = np.cos(elevation), np.sin(elevation)
    across[0] = 0.0
    up[-1] = 0.0
    points = RADIUS * np.stack(np.broadcast_arrays(across * x, up, across * z), -1)
    u = np.linspace(0.0, 2.0, SEGMENTS + 1)
    v = np.linspace(EDGE, 1.0 - EDGE, RINGS + 1)[:, None]
    return surface(points, np.stack(np.broadcast_arrays(u, v), -1), -points / RADIUS).without_tangents()


def _meadow() -> Mesh:
    """Return the ground between the sky's foot and a line under the galleries' floor, at height 0."""
    x, z = _azimuths()
    inner = np.array([HALF_X, HALF_Z]) + 0.6 * GALLERY
    to_line = np.minimum(inner[0] / np.maximum(np.abs(x), 1e-9), inner[1] / np.maximum(np.abs(z), 1e-9))
    zero = np.zeros_like(x)
    ring = [
        np.stack([x * reach, zero, z * reach], -1)
        for reach in (RADIUS, 0.4 * RADIUS + 0.6 * to_line, to_line)
    ]
    points = np.array(ring)
    return surface(points, points[..., [0, 2]] * MEADOW).without_tangents()


def _path() -> Mesh:
    """Return the gravel from the portal to where the painted path begins, just above the meadow."""
    near, far, y = AWAY + 0.3, AWAY + 4.0, 0.0125
    points = np.array([[(near, y, -0.8), (far, y, -1.35)], [(near, y, 0.8), (far, y, -0.1)]])
    return surface(points, points[..., [0, 2]])
