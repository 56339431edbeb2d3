"""The meshes of the study: surfaces of revolution, closed and open, in one list of vertices and one of indices."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

AROUND = 16
"""Steps around the axis."""

Profile = NDArray[np.float64]
"""(N, 4): distance of points from the axis, their height, and both parts of the normal; upwards on the outside."""


class Mesh(NamedTuple):
    """A mesh's place in the lists of all meshes: vertices [first_vertex, ...), indices [first_index, + index_count)."""

    index_count: int
    first_index: int
    first_vertex: int


class Meshes(NamedTuple):
    """All meshes: `positions` and `normals` (V, 3) float32, `indices` (I,) uint32, and the places of each mesh."""

    positions: NDArray[np.float32]
    normals: NDArray[np.float32]
    indices: NDArray[np.uint32]
    closed: list[Mesh]
    open: list[Mesh]


def _arc(middle: float, radius: float, begin: float, end: float, steps: int) -> Profile:
    """Return a part of a circle around (middle, 0), from one angle to another, in turns; 0 is outward, 1/4 is up."""
    angles = 2.0 * np.pi * np.linspace(begin, end, steps + 1)
    normals = np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    return np.concatenate([normals * radius + [middle, 0.0], normals], axis=-1)


def _line(start: tuple[float, float], end: tuple[float, float]) -> Profile:
    """Return a straight piece of a profile. Its normal is to the right of its direction."""
    along = np.subtract(end, start)
    normal = np.array([along[1], -along[0]]) / np.hypot(*along)
    return np.array([[*start, *normal], [*end, *normal]])


BALL = [_arc(0.0, 1.0, -0.25, 0.25, 8)]
RING = [_arc(0.7, 0.3, -0.5, 0.5, 10)]
CAN = [_line((0.0, -0.9), (0.6, -0.9)), _line((0.6, -0.9), (0.6, 0.9)), _line((0.6, 0.9), (0.0, 0.9))]
BOWL = [_arc(0.0, 1.0, -0.25, 0.0, 6)]
FUNNEL = [_line((0.15, -0.9), (0.9, 0.9))]


def _revolved(pieces: list[Profile]) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.int64]]:
    """Return positions, normals and triangles of a profile around the y axis, counter-clockwise from outside.

    Pieces share no vertices, so edges between them are sharp. Triangles that a point on the axis would flatten are left
    out.
    """
    turns = 2.0 * np.pi * np.arange(AROUND) / AROUND
    outward = np.stack([np.cos(turns), np.zeros(AROUND), -np.sin(turns)], axis=-1)
    up = np.array([0.0, 1.0, 0.0])
    positions, normals, triangles, first = [], [], [], 0
    for piece in pieces:
        radius, height, radial, upward = (piece[:, None, column, None] for column in range(4))
        positions.append((radius * outward + height * up).reshape(-1, 3))
        normals.append((radial * outward + upward * up).reshape(-1, 3))
        i, j = np.meshgrid(np.arange(len(piece) - 1), np.arange(AROUND), indexing="ij")
        a, b = first + i * AROUND + j, first + i * AROUND + (j + 1) % AROUND
        c, d = a + AROUND, b + AROUND
        lower, upper = np.abs(piece[:-1, 0]) > 1e-9, np.abs(piece[1:, 0]) > 1e-9
        triangles.append(np.stack([a, b, d], axis=-1)[lower].reshape(-1, 3))
        triangles.append(np.stack([a, d, c], axis=-1)[upper].reshape(-1, 3))
        first += len(piece) * AROUND
    return np.concatenate(positions), np.concatenate(normals), np.concatenate(triangles)


def all_meshes() -> Meshes:
    """Return the meshes of the study."""
    places: list[Mesh] = []
    positions, normals, indices = [], [], []
    first_index = first_vertex = 0
    for profile in (BALL, RING, CAN, BOWL, FUNNEL):
        points, directions, triangles = _revolved(profile)
        positions.append(points)
        normals.append(directions)
        indices.append(triangles.ravel())
        places.append(Mesh(triangles.size, first_index, first_vertex))
        first_index += triangles.size
        first_vertex += len(points)
    return Meshes(
        np.concatenate(positions).astype(np.float32),
        np.concatenate(normals).astype(np.float32),
        np.concatenate(indices).astype(np.uint32),
        places[:3],
        places[3:],
    )
