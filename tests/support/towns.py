"""A scene for culling: round and square things behind walls, of every kind of material and transform."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from common.numerics.transforms import pose_looking_at
from common.scene import MESH_DTYPE, Instances, Light, Material, Scene
from common.view.camera import Perspective, View
from tests.support.scenes import nodes_at, quad_scene

KINDS = (
    Material(base_color=(0.8, 0.5, 0.3, 1), roughness=0.6, metallic=0.0),
    Material(base_color=(0.3, 0.6, 0.8, 1), roughness=0.4, metallic=0.5, double_sided=True),
    Material(base_color=(0.6, 0.7, 0.3, 0.7), alpha_mode="mask", alpha_cutoff=0.5, double_sided=True),
    Material(base_color=(0.9, 0.3, 0.5, 0.4), alpha_mode="blend"),
)
OPAQUE, TWO_SIDED, MASKED, BLENDED = range(4)


def ball(rings: int = 12, around: int = 20) -> tuple[np.ndarray, np.ndarray]:
    """Return positions (V, 3) and triangles (T, 3) of a closed sphere of radius 1, seen from outside."""
    theta, phi = np.meshgrid(
        np.linspace(0, np.pi, rings + 1), np.linspace(0, 2 * np.pi, around + 1), indexing="ij"
    )
    place = np.stack([np.sin(theta) * np.cos(phi), np.cos(theta), -np.sin(theta) * np.sin(phi)], axis=-1)
    first = (np.arange(rings)[:, None] * (around + 1) + np.arange(around)).reshape(-1)
    down = first + around + 1
    triangles = np.concatenate(
        [np.stack([first, down, first + 1], 1), np.stack([first + 1, down, down + 1], 1)]
    )
    return place.reshape(-1, 3).astype(np.float32), triangles.astype(np.uint32)


def cube() -> tuple[np.ndarray, np.ndarray]:
    """Return positions and triangles of a cube from -1 to 1."""
    corners = np.array(np.meshgrid([-1, 1], [-1, 1], [-1, 1], indexing="ij")).reshape(3, 8).T
    faces = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    triangles = [t for a, b, c, d in faces for t in ((a, b, c), (a, c, d))]
    return corners.astype(np.float32), np.array(triangles, np.uint32)


def grid(side: int = 16) -> tuple[np.ndarray, np.ndarray]:
    """Return a wavy square of side x side quads in the plane z = 0, from -1 to 1, that faces +z."""
    at = np.linspace(-1, 1, side + 1)
    x, y = np.meshgrid(at, at)
    place = np.stack([x, y, 0.05 * np.sin(5 * x) * np.cos(4 * y)], axis=-1).reshape(-1, 3)
    corner = (np.arange(side)[:, None] * (side + 1) + np.arange(side)).reshape(-1)
    right, up = corner + 1, corner + side + 1
    triangles = np.concatenate([np.stack([corner, right, up + 1], 1), np.stack([corner, up + 1, up], 1)])
    return place.astype(np.float32), triangles.astype(np.uint32)


def of_shapes(
    shapes: list[tuple[np.ndarray, np.ndarray]],
    materials: list[int],
    mesh: np.ndarray,
    matrices: np.ndarray,
    kinds: tuple[Material, ...] = KINDS,
) -> Scene:
    """Return a scene with shape i in material `materials[i]`, drawn as `mesh` (I,) with `matrices` (I, 4, 4)."""
    rows = np.zeros(len(shapes), MESH_DTYPE)
    vertex = index = 0
    for row, (positions, triangles) in zip(rows, shapes, strict=True):
        row["first_vertex"], row["vertex_count"] = vertex, len(positions)
        row["first_index"], row["index_count"] = index, triangles.size
        row["bounds_min"], row["bounds_max"] = positions.min(axis=0), positions.max(axis=0)
        vertex, index = vertex + len(positions), index + triangles.size
    rows["material"] = materials
    positions = np.concatenate([positions for positions, _ in shapes])
    normals = positions / np.maximum(np.linalg.norm(positions, axis=1, keepdims=True), 1e-6)
    base = quad_scene(materials=kinds)
    return replace(
        base,
        positions=positions,
        normals=normals.astype(np.float32),
        tangents=np.tile(np.float32((1, 0, 0, 1)), (len(positions), 1)),
        uv0=positions[:, :2].copy(),
        indices=np.concatenate([triangles.reshape(-1) for _, triangles in shapes]),
        meshes=rows,
        mesh_names=[f"shape {number}" for number in range(len(shapes))],
        nodes=nodes_at(*matrices),
        instances=Instances(np.arange(len(mesh), dtype=np.int32), mesh.astype(np.int32)),
        lights=[Light("directional", node=0, intensity=3.0)],
    )


def town(seed: int = 1, count: int = 60) -> Scene:
    """Return `count` things in a square of 20 m, with walls between them: mirrored, stretched and sheared ones, too."""
    rng = np.random.default_rng(seed)
    shapes = [ball(), cube(), grid(), ball(6, 9), ball(), grid(), cube()]
    kinds = [OPAQUE, OPAQUE, OPAQUE, TWO_SIDED, MASKED, BLENDED, BLENDED]
    mesh = rng.integers(0, len(shapes), count)
    matrices = np.zeros((count, 4, 4))
    for number, matrix in enumerate(matrices):
        matrix[:] = np.eye(4)
        linear = np.linalg.qr(rng.normal(size=(3, 3)))[0] * rng.uniform(0.3, 1.2)
        if number % 5 == 1:
            linear = linear @ np.diag(rng.uniform(0.3, 2.0, 3))
        if number % 5 == 2:
            linear = linear @ np.array([[1, rng.uniform(-1, 1), 0], [0, 1, rng.uniform(-1, 1)], [0, 0, 1]])
        matrix[:3, :3] = linear * (-1 if number % 7 == 3 else 1)
        matrix[:3, 3] = rng.uniform((-10, 0, -10), (10, 2, 10))
    for number, x in enumerate((-6.0, -2.0, 2.0, 6.0)):  # walls, and a floor
        matrices[number] = np.eye(4)
        matrices[number, :3, :3] = np.diag((0.1, 3.0, 3.5 + number))
        matrices[number, :3, 3] = (x, 1.5, -1.0 + number)
        mesh[number] = 1
    matrices[4] = np.eye(4)
    matrices[4, :3, :3] = np.diag((14.0, 0.1, 14.0))
    matrices[4, :3, 3] = (0, -0.6, 0)
    mesh[4] = 1
    return of_shapes(shapes, kinds, mesh, matrices)


def walk(steps: int = 6) -> list[View]:
    """Return views of a walk through a town that ends in a jump to its other side."""
    views = []
    for step in range(steps):
        eye = np.array((-9.0 + 0.4 * step, 1.2, 8.0 - 0.5 * step))
        views.append(View(pose_looking_at(eye, (1.0 - step, 0.5, -2.0)), Perspective(0.9, 0.05)))
    views.append(View(pose_looking_at((9.0, 1.0, -9.0), (0.0, 0.5, 0.0)), Perspective(0.9, 0.05)))
    views.append(View(pose_looking_at((0.0, 12.0, 1.0), (0.0, 0.0, 0.0)), Perspective(0.9, 0.05)))
    return views


__all__ = ["KINDS", "ball", "cube", "grid", "of_shapes", "town", "walk"]
