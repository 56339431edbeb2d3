"""Directions of an environment, to and from a panorama and a cube map: `shaders/environment.glsl` again, in float64.

The world is right-handed with y up. The middle of a panorama is seen along -z, u grows to the right, v down from the
zenith. Faces of a cube are in the order +x, -x, +y, -y, +z, -z and turned as OpenGL and Vulkan turn them.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

Float64 = NDArray[np.float64]

# For each face: the axis it stands on, and what (s, t) from -1 to 1 are multiplied by: (Vulkan specification, table
# "Cube map face and coordinate selection").
_MAJOR = np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]], np.float64)
_RIGHT = np.array([[0, 0, -1], [0, 0, 1], [1, 0, 0], [1, 0, 0], [1, 0, 0], [-1, 0, 0]], np.float64)
_DOWN = np.array([[0, -1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1], [0, -1, 0], [0, -1, 0]], np.float64)


def panorama_uv(directions: ArrayLike) -> Float64:
    """Return where a panorama shows directions (..., 3) of any length: (..., 2), from 0 to 1."""
    d = np.asarray(directions, np.float64)
    aside = np.hypot(d[..., 0], d[..., 2])
    u = np.where(aside > 0, 0.5 + np.arctan2(d[..., 0], -d[..., 2]) / (2 * np.pi), 0.5)
    return np.stack([u, np.arctan2(aside, d[..., 1]) / np.pi], axis=-1)


def panorama_direction(uv: ArrayLike) -> Float64:
    """Return the unit directions (..., 3) that a panorama shows at uv (..., 2)."""
    uv = np.asarray(uv, np.float64)
    azimuth, polar = (uv[..., 0] - 0.5) * 2 * np.pi, uv[..., 1] * np.pi
    return np.stack(
        [np.sin(polar) * np.sin(azimuth), np.cos(polar), -np.sin(polar) * np.cos(azimuth)], axis=-1
    )


def panorama_directions(height: int) -> Float64:
    """Return the unit directions (H, 2H, 3) of the pixels' centres."""
    u, v = (np.arange(2 * height) + 0.5) / (2 * height), (np.arange(height) + 0.5) / height
    return panorama_direction(np.stack(np.meshgrid(u, v), axis=-1))


def panorama_solid_angles(height: int) -> Float64:
    """Return the solid angle (H, 1) of a pixel in each row, exactly: a band between two polar angles, cut in 2H."""
    edges = np.cos(np.arange(height + 1) / height * np.pi)
    return ((edges[:-1] - edges[1:]) * np.pi / height)[:, None]


def cube_direction(face: ArrayLike, uv: ArrayLike) -> Float64:
    """Return the directions (..., 3) through uv (..., 2) of faces (...), with 1 as the largest coordinate."""
    face, p = np.asarray(face, np.intp), np.asarray(uv, np.float64) * 2 - 1
    return _MAJOR[face] + p[..., :1] * _RIGHT[face] + p[..., 1:] * _DOWN[face]


def cube_uv(directions: ArrayLike) -> tuple[NDArray[np.intp], Float64]:
    """Return the faces (...) that directions (..., 3) meet, and the uv (..., 2) there; z wins over y, y over x."""
    d = np.asarray(directions, np.float64)
    size = np.abs(d)
    axis = np.where(
        (size[..., 2] >= size[..., 0]) & (size[..., 2] >= size[..., 1]),
        2,
        np.where(size[..., 1] >= size[..., 0], 1, 0),
    )
    along = np.take_along_axis(d, axis[..., None], axis=-1)[..., 0]
    face = 2 * axis + (along < 0)
    p = np.stack([(d * _RIGHT[face]).sum(axis=-1), (d * _DOWN[face]).sum(axis=-1)], axis=-1)
    return face, p / np.abs(along)[..., None] * 0.5 + 0.5


def cube_directions(size: int) -> Float64:
    """Return the unit directions (6, size, size, 3) of a cube's texel centres."""
    at = (np.arange(size) + 0.5) / size
    grid = np.stack(np.meshgrid(at, at), axis=-1)
    d = cube_direction(np.arange(6)[:, None, None], grid[None])
    return d / np.linalg.norm(d, axis=-1, keepdims=True)


def cube_solid_angles(size: int) -> Float64:
    """Return the exact solid angles (size, size) of the texels of one face; those of all six sum to 4 pi.

    The part of a face from its centre to (x, y) has the solid angle atan(x y / sqrt(x^2 + y^2 + 1)).
    """
    edge = np.arange(size + 1) / size * 2 - 1
    x, y = np.meshgrid(edge, edge)
    corner = np.arctan2(x * y, np.sqrt(x * x + y * y + 1))
    return np.asarray(np.diff(np.diff(corner, axis=0), axis=1))


def turn_back(directions: ArrayLike, angle: float) -> Float64:
    """Return directions (..., 3) as an environment has them that was turned by `angle` about +y.

    Counter-clockwise seen from above; what a camera sees is the environment at the direction turned back.
    """
    d = np.asarray(directions, np.float64)
    c, s = np.cos(angle), np.sin(angle)
    return np.stack([c * d[..., 0] - s * d[..., 2], d[..., 1], s * d[..., 0] + c * d[..., 2]], axis=-1)
