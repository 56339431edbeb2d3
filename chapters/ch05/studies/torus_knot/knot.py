"""Torus knots on the CPU, in double precision: the curve, the tube around it, and the triangles between its points.

A (P, Q) knot goes P times around the axis of a torus while it goes Q times through its hole. P and Q have no common
factor: with one, the curve closes early and repeats.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

RING = 5.0
"""Distance from the axis to the middle of the torus."""
HOLE = 3.0
"""Distance from there to the knot."""
TUBE = 0.5
"""Distance from the knot to the surface that is drawn around it."""
REACH = RING + HOLE + TUBE
"""Greatest distance from the middle."""

Array = NDArray[np.float64]


def turns_of(count: int) -> Array:
    """Return (count,) equal parts of a turn; the last is 1, at the place of the first."""
    return np.arange(count) / (count - 1)


def curve(p: int, q: int, u: Array) -> tuple[Array, Array]:
    """Return the points (..., 3) of a knot and their derivative by the angle around the axis; u is 0 to 1."""
    t, s = (
        math.tau * (p * u % 1.0),
        math.tau * (q * u % 1.0),
    )  # the angle through the hole is q / p of that around it
    away = RING + HOLE * np.cos(s)
    points = np.stack([away * np.cos(t), away * np.sin(t), HOLE * np.sin(s)], axis=-1)
    inward, upward = -q / p * HOLE * np.sin(s), q / p * HOLE * np.cos(s)
    along = np.stack(
        [inward * np.cos(t) - away * np.sin(t), inward * np.sin(t) + away * np.cos(t), upward], axis=-1
    )
    return points, along


def tube(p: int, q: int, u: Array, v: Array) -> tuple[Array, Array]:
    """Return positions and outward unit normals, (len(u), len(v), 3) each, of a tube around a knot; v as u.

    Two vectors across the curve span the circle. The first is perpendicular to the curve and to its radius vector, the
    second to the first and the curve. The vector from the curve to the surface is the normal.
    """
    points, along = curve(p, q, u)
    first_axis = _unit(np.cross(points, along))
    second_axis = _unit(np.cross(first_axis, along))
    angle = math.tau * (v % 1.0)[None, :, None]
    normals = first_axis[:, None] * np.sin(angle) + second_axis[:, None] * np.cos(angle)
    return points[:, None] + TUBE * normals, normals


def morphed(knots: tuple[int, int, int, int], morph: float, u: Array, v: Array) -> tuple[Array, Array]:
    """Return positions and unit normals between two knots (P, Q, P, Q), interpolated linearly.

    A mean of unit vectors is shorter than they are. Where they are opposite it is zero, and the first one is used.
    """
    positions, normals = zip(tube(*knots[:2], u, v), tube(*knots[2:], u, v), strict=True)
    mixed = normals[0] * (1.0 - morph) + normals[1] * morph
    lost = (mixed**2).sum(axis=-1, keepdims=True) < 1e-12
    return positions[0] * (1.0 - morph) + positions[1] * morph, _unit(np.where(lost, normals[0], mixed))


def indices(along: int, around: int) -> NDArray[np.uint32]:
    """Return (2 (along - 1) (around - 1), 3) uint32: two triangles for each cell, counter-clockwise from outside.

    Point (i, j) is vertex i * around + j: the length of a row is that of the second axis. With the length of the first
    one in its place only square grids are right.
    """
    i, j = np.meshgrid(np.arange(along - 1), np.arange(around - 1), indexing="ij")
    first = (i * around + j).ravel()
    cells = np.stack(
        [first, first + 1, first + around, first + around, first + 1, first + around + 1], axis=-1
    )
    return cells.reshape(-1, 3).astype(np.uint32)


def _unit(vectors: Array) -> Array:
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)
