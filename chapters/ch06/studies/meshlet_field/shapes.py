"""The meshes of the field: closed surfaces, each a grid of about 4,800 triangles."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

ALONG, AROUND = 60, 40
"""Steps of the grids in both directions."""


class Mesh(NamedTuple):
    """`positions` and `normals` (V, 3) float64, within a sphere of radius 1, and `indices` (T, 3), ccw from outside."""

    positions: NDArray[np.float64]
    normals: NDArray[np.float64]
    indices: NDArray[np.int64]


def all_meshes() -> list[Mesh]:
    """Return the four meshes: a ring, a cog, a knot and a pebble."""
    t = 2.0 * np.pi * np.arange(ALONG) / ALONG
    circle = np.stack([np.cos(t), np.sin(t), np.zeros(ALONG)], axis=-1)
    knot = [np.sin(t) + 2 * np.sin(2 * t), np.cos(t) - 2 * np.cos(2 * t), -np.sin(3 * t)]
    return [
        _mesh(_tube(0.68 * circle, np.full(ALONG, 0.32)), True),
        _mesh(_tube(0.66 * circle, 0.26 + 0.08 * np.sin(8 * t)), True),
        _mesh(_tube(np.stack(knot, axis=-1), np.full(ALONG, 0.5)), True),
        _mesh(_pebble(t), False),
    ]


def _tube(middle: NDArray[np.float64], radius: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return points (ALONG, AROUND, 3) around a closed curve (ALONG, 3) that is nowhere parallel to the z axis."""
    along = np.roll(middle, -1, axis=0) - np.roll(middle, 1, axis=0)
    along /= np.linalg.norm(along, axis=-1, keepdims=True)
    side = np.cross(along, (0.0, 0.0, 1.0))
    side /= np.linalg.norm(side, axis=-1, keepdims=True)
    turn = 2.0 * np.pi * np.arange(AROUND) / AROUND
    frame = np.stack([side, np.cross(side, along)], axis=1)
    ring = np.stack([np.cos(turn), np.sin(turn)], axis=-1)
    return middle[:, None] + radius[:, None, None] * np.einsum("jk,ikc->ijc", ring, frame)


def _pebble(t: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return points (AROUND + 1, ALONG, 3) of a sphere with dents; all points of the first and last row are a pole."""
    polar = np.pi * np.arange(AROUND + 1)[:, None] / AROUND
    sine = np.sin(polar) * (np.arange(AROUND + 1)[:, None] % AROUND > 0)  # exactly 0 at both poles
    sphere = np.stack([sine * np.cos(t), np.cos(polar) + 0.0 * t, sine * np.sin(t)], axis=-1)
    return sphere * (1.0 + 0.12 * sine**3 * np.sin(5 * t) + 0.08 * np.cos(6 * polar))[..., None]


def _mesh(points: NDArray[np.float64], closed: bool) -> Mesh:
    """Return the triangles of a grid (R, C, 3) whose columns wrap around, and whose rows do if it is `closed`."""
    rows, columns = points.shape[:2]
    i, j = np.meshgrid(np.arange(rows if closed else rows - 1), np.arange(columns), indexing="ij")
    a, b = i * columns + j, i * columns + (j + 1) % columns
    c, d = (a + columns) % (rows * columns), (b + columns) % (rows * columns)
    triangles = np.stack([a, b, d, a, d, c], axis=-1).reshape(-1, 3)
    positions = points.reshape(-1, 3) / np.linalg.norm(points, axis=-1).max()
    corners = positions[triangles]
    areas = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    if np.einsum("ij,ij->", corners[:, 0], areas) < 0:  # six times the volume: it faces inwards
        triangles, areas = triangles[:, ::-1], -areas
    kept = np.linalg.norm(areas, axis=-1) > 1e-12  # not those that a pole flattens
    triangles, areas = triangles[kept], areas[kept]
    normals = np.zeros_like(positions)
    np.add.at(normals, triangles, areas[:, None])
    return Mesh(positions, normals / np.linalg.norm(normals, axis=-1, keepdims=True), triangles)
