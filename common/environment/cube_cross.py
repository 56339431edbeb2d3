"""From a panorama to a cube map on the CPU, by way of a vertical cross: the six faces laid out as in a paper model.

A cross is a picture that people can look at and paint in; renderers make their cubes straight from the panorama
(`shaders/environment.glsl`). Here z is up, as in the pictures that are laid out this way: the whole chain is the
rotation that sends direction d of OpenGL's cube to the panorama's (-d.z, -d.x, d.y). The layout is that of the 3D
Graphics Rendering Cookbook (Kosarevsky, Latypov 2021), with directions through the middle of texels, not their corners.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

Float64 = NDArray[np.float64]
Array = NDArray[Any]

_OFFSETS = ((1, 3), (0, 1), (1, 1), (2, 1), (1, 0), (1, 2))
"""Column and row of each face in the cross, in faces."""


def cross_directions(edge: int) -> tuple[Float64, NDArray[np.bool_]]:
    """Return directions (4 edge, 3 edge, 3), with 1 as largest coordinate, and which pixels (...) the cross covers."""
    at = 2 * (np.arange(edge) + 0.5) / edge - 1
    a, b = np.meshgrid(at, at)
    unit = np.ones_like(a)
    faces = ((-unit, a, b), (a, -unit, -b), (unit, a, -b), (-a, unit, -b), (b, a, unit), (-b, a, -unit))
    directions, covered = np.zeros((4 * edge, 3 * edge, 3)), np.zeros((4 * edge, 3 * edge), bool)
    for (column, row), face in zip(_OFFSETS, faces, strict=True):
        place = np.s_[row * edge : (row + 1) * edge, column * edge : (column + 1) * edge]
        directions[place], covered[place] = np.stack(face, axis=-1), True
    return directions, covered


def cross_from_panorama(panorama: ArrayLike) -> Float64:
    """Return the cross (W, 3 W / 4, C) of a panorama (W / 2, W, C), between pixels linearly; black where no face is."""
    pixels = np.asarray(panorama, np.float64)
    height, width = pixels.shape[:2]
    if width != 2 * height or width % 4:
        raise ValueError(f"a panorama is twice as wide as high, a multiple of 4, not {width} x {height}")
    d, covered = cross_directions(width // 4)
    theta = np.arctan2(d[..., 1], d[..., 0])
    phi = np.arctan2(d[..., 2], np.hypot(d[..., 0], d[..., 1]))
    u = (theta + np.pi) / (2 * np.pi) * width - 0.5
    v = np.clip((np.pi / 2 - phi) / np.pi * height - 0.5, 0, height - 1)
    left, top = np.floor(u).astype(np.intp), np.floor(v).astype(np.intp)
    s, t = (u - left)[..., None], (v - top)[..., None]
    columns, rows = (left % width, (left + 1) % width), (top, np.minimum(top + 1, height - 1))
    upper = pixels[rows[0], columns[0]] * (1 - s) + pixels[rows[0], columns[1]] * s
    lower = pixels[rows[1], columns[0]] * (1 - s) + pixels[rows[1], columns[1]] * s
    return np.asarray(np.where(covered[..., None], upper * (1 - t) + lower * t, 0.0))


def faces_from_cross(cross: Array) -> Array:
    """Return the faces (6, n, n, C), in OpenGL's order and turned as it turns them, of a cross (4 n, 3 n, C)."""
    edge = cross.shape[0] // 4
    if cross.shape[:2] != (4 * edge, 3 * edge):
        raise ValueError(f"a cross is four faces high and three wide, not {cross.shape[:2]}")

    def cut(column: int, row: int) -> Array:
        return cross[row * edge : (row + 1) * edge, column * edge : (column + 1) * edge]

    half_turn = np.s_[::-1, ::-1]
    return np.stack(
        [cut(0, 1), cut(2, 1), cut(1, 0)[half_turn], cut(1, 2)[half_turn], cut(1, 3)[half_turn], cut(1, 1)]
    )
