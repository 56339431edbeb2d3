"""Vertices moved by morph targets and skins, in float64 numpy."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from common.numerics.transforms import normal_matrix, normalize
from common.scene import Float32, Float64

Vertices = tuple[Float64, Float64, Float64]
"""Positions (V, 3), unit normals (V, 3), tangents (V, 4)."""


def morph(
    vertices: Vertices,
    weights: Float64,
    positions: Float32 | None,
    normals: Float32 | None,
    tangents: Float32 | None,
) -> Vertices:
    """Return vertices plus the weighted sum of target offsets, each (T, V, 3); targets of weight 0 cost nothing."""
    moved = [part.copy() for part in vertices]
    for target in np.flatnonzero(weights):
        for part, offsets in zip(moved, (positions, normals, tangents), strict=True):
            if offsets is not None:
                part[:, :3] += weights[target] * offsets[target]
    return tidied(moved[0], moved[1], moved[2])


def skin(vertices: Vertices, matrices: Float64, joints: NDArray[np.int32], weights: Float64) -> Vertices:
    """Return vertices moved by the weighted sum of joint matrices (J, 4, 4), linear blend skinning.

    `joints` and `weights` are (V, K). Normals take the inverse transpose of each vertex's own blended matrix,
    so they stay right where joints scale or mirror.
    """
    rows = matrices[:, :3].reshape(-1, 12)
    blended = np.zeros((len(joints), 12))
    for influence in range(joints.shape[1]):
        blended += weights[:, influence, None] * rows[joints[:, influence]]
    transforms = blended.reshape(-1, 3, 4)
    linear = transforms[:, :, :3]
    positions = np.einsum("vij,vj->vi", linear, vertices[0]) + transforms[:, :, 3]
    normals = np.einsum("vij,vj->vi", normal_matrix(linear), vertices[1])
    tangents = vertices[2].copy()
    tangents[:, :3] = np.einsum("vij,vj->vi", linear, vertices[2][:, :3])
    return tidied(positions, normals, tangents)


def tidied(positions: Float64, normals: Float64, tangents: Float64) -> Vertices:
    """Make normals unit and tangents perpendicular to them; what has no direction becomes +z, or some tangent."""
    normals = normalize(normals)
    normals[~normals.any(axis=1)] = (0.0, 0.0, 1.0)
    along = tangents[:, :3] - normals * (normals * tangents[:, :3]).sum(axis=1, keepdims=True)
    along = normalize(along)
    lost = np.flatnonzero(~along.any(axis=1))
    helper = np.eye(3)[np.abs(normals[lost]).argmin(axis=1)]
    along[lost] = normalize(np.cross(normals[lost], helper))
    tangents = np.concatenate([along, tangents[:, 3:]], axis=1)
    return positions, normals, tangents


def flat(vertices: Vertices) -> Vertices:
    """Return vertices with the normals of their triangles, three unshared vertices each."""
    corners = vertices[0].reshape(-1, 3, 3)
    normals = normalize(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]))
    return tidied(vertices[0], np.repeat(normals, 3, axis=0), vertices[2])
