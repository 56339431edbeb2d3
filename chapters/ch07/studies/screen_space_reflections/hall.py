"""The scene of the study: columns on a floor of four mirrors, each rougher than the one to its left, under the sky."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from common.environment.sky import sky
from common.numerics.transforms import pose_looking_at, rotation
from common.scene import MESH_DTYPE, Instances, Light, Material, Nodes, Scene, SceneCamera

Float64 = NDArray[np.float64]
Shape = tuple[Float64, Float64, NDArray[np.int64]]
"""Positions and normals (V, 3), and triangles (T, 3)."""

Place = tuple[tuple[float, float, float], tuple[float, float, float]]
"""Where a mesh stands, and its scale along x, y and z."""

ROUGHNESS = (0.0, 0.12, 0.25, 0.45)
"""Of the four parts of the floor, from left to right."""

COLORS = ((0.8, 0.12, 0.1), (0.9, 0.55, 0.1), (0.15, 0.6, 0.2), (0.1, 0.35, 0.8), (0.75, 0.75, 0.72))
"""Base colours of the columns; the last one is also the wall's."""

SIDES = 24
"""Sides of a column."""


def hall() -> Scene:
    """Return the scene; the sun is a light of its own, apart from the sky's."""
    floor = [
        Material(f"floor {roughness:g}", base_color=(0.75, 0.77, 0.8, 1.0), roughness=roughness)
        for roughness in ROUGHNESS
    ]
    paint = [Material(f"column {i}", (*color, 1.0), 0.0, 0.8) for i, color in enumerate(COLORS)]
    lamp = Material("lamp", (0.0, 0.0, 0.0, 1.0), 0.0, 1.0, emissive=(4e4, 2e4, 5e3))
    # Each mesh, its material, and the places where it stands.
    parts: list[tuple[Shape, int, list[Place]]] = [
        (_tile(), i, [((-4.5 + 3 * i, 0, 0), (1.5, 1, 6))]) for i, _ in enumerate(floor)
    ]
    columns = [(-4.6, -1.0), (-3.1, -3.2), (-1.5, 0.6), (-0.2, -2.2), (1.4, -0.4), (2.8, -3.0), (4.5, 0.2)]
    for i in range(4):
        stand: list[Place] = [
            ((x, 0, z), (0.35, 1.4 + 0.3 * (k % 3), 0.35)) for k, (x, z) in enumerate(columns) if k % 4 == i
        ]
        parts.append((_column(), len(floor) + i, stand))
    parts.append((_box(), len(floor) + 4, [((0, 0, -6), (6, 2.4, 0.15))]))
    parts.append((_box(), len(floor) + 5, [((x, 1.3, -5.8), (0.25, 0.3, 0.05)) for x in (-4, -1.4, 1.4, 4)]))
    return _scene(parts, [*floor, *paint, lamp])


def _tile() -> Shape:
    """Return a square from -1 to 1 in x and z that faces up."""
    corners = np.array([(-1, 0, 1), (1, 0, 1), (1, 0, -1), (-1, 0, -1)], np.float64)
    return corners, np.tile((0.0, 1.0, 0.0), (4, 1)), np.array([(0, 1, 2), (0, 2, 3)])


def _column() -> Shape:
    """Return a cylinder of radius 1 from y = 0 to 1, closed at the top."""
    turn = 2 * np.pi * np.arange(SIDES + 1) / SIDES
    ring = np.stack([np.cos(turn), 0 * turn, -np.sin(turn)], axis=1)
    up, i = np.array([0.0, 1.0, 0.0]), np.arange(SIDES)
    above, top = SIDES + 1 + i, 2 * (SIDES + 1) + i
    positions = np.concatenate([ring, ring + up, ring + up, [up]])
    normals = np.concatenate([ring, ring, np.tile(up, (SIDES + 2, 1))])
    sides = [(i, i + 1, above + 1), (i, above + 1, above), (top, top + 1, np.full(SIDES, len(positions) - 1))]
    return positions, normals, np.concatenate([np.stack(side, axis=1) for side in sides])


def _box() -> Shape:
    """Return a box from -1 to 1 in x and z, and from 0 to 1 in y."""
    corner = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)], np.float64)
    positions, normals = [], []
    for axis in range(3):
        for side in (1.0, -1.0):
            normal = np.roll((side, 0.0, 0.0), axis)
            right = np.roll((0.0, 1.0, 0.0), axis)
            positions.append(normal + corner[:, :1] * right + corner[:, 1:] * np.cross(normal, right))
            normals.append(np.tile(normal, (4, 1)))
    triangles = (4 * np.arange(6)[:, None, None] + np.array([(0, 1, 2), (0, 2, 3)])).reshape(-1, 3)
    return np.concatenate(positions) * (1, 0.5, 1) + (0, 0.5, 0), np.concatenate(normals), triangles


def _scene(parts: list[tuple[Shape, int, list[Place]]], materials: list[Material]) -> Scene:
    meshes = np.zeros(len(parts), MESH_DTYPE)
    positions, normals, indices, local, drawn = [], [], [], [], []
    vertices = triangles = 0
    for number, ((points, facing, faces), material, places) in enumerate(parts):
        meshes[number]["first_vertex"], meshes[number]["vertex_count"] = vertices, len(points)
        meshes[number]["first_index"], meshes[number]["index_count"] = 3 * triangles, 3 * len(faces)
        meshes[number]["bounds_min"], meshes[number]["bounds_max"] = points.min(axis=0), points.max(axis=0)
        meshes[number]["material"] = material
        vertices, triangles = vertices + len(points), triangles + len(faces)
        positions.append(points)
        normals.append(facing)
        indices.append(faces.ravel())
        for at, scale in places:
            matrix = np.diag([*scale, 1.0])
            matrix[:3, 3] = at
            local.append(matrix)
            drawn.append(number)
    count = vertices
    far = sky()
    poses = np.stack(
        [np.eye(4), pose_looking_at((0.6, 1.5, 6.4), (0.0, 0.75, -1.0)), rotation((1, 0.6, 0), -0.9)]
    )
    return Scene(
        name="hall of mirrors",
        path=None,
        positions=np.concatenate(positions).astype(np.float32),
        normals=np.concatenate(normals).astype(np.float32),
        tangents=np.tile((1.0, 0.0, 0.0, 1.0), (count, 1)).astype(np.float32),
        uv0=np.zeros((count, 2), np.float32),
        uv1=None,
        colors=None,
        indices=np.concatenate(indices).astype(np.uint32),
        meshes=meshes,
        mesh_names=[materials[mesh["material"]].name for mesh in meshes],
        materials=materials,
        images=[],
        nodes=Nodes(
            parent=np.full(3, -1, np.int32),
            translation=np.zeros((3, 3)),
            rotation=np.tile((0.0, 0.0, 0.0, 1.0), (3, 1)),
            scale=np.ones((3, 3)),
            matrix=poses,
            has_matrix=np.ones(3, bool),
            names=["hall", "camera", "sun"],
        ),
        instances=Instances(np.zeros(len(drawn), np.int32), np.array(drawn, np.int32), np.array(local)),
        lights=[Light("directional", 2, "sun", (1.0, 0.95, 0.85), 40_000.0)],
        cameras=[SceneCamera("front", 1, yfov=np.radians(45.0), ev100=14.0)],
        animations=[],
        deformations=[],
        environment=far,
    )
