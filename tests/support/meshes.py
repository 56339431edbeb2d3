"""Meshes for tests, built in memory: bumpy grids, and scenes of several of them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from common.scene import MESH_DTYPE, Instances, Material, Scene
from tests.support.scenes import nodes_at, quad_scene

Grid = tuple[np.ndarray, np.ndarray]


def grid(rows: int, columns: int, height: float = 0.1, seed: int = 0) -> Grid:
    """Return positions (V, 3) over the unit square, waves of `height` with noise, and indices row by row."""
    y, x = np.mgrid[0 : rows + 1, 0 : columns + 1].astype(float)
    z = np.sin(5 * x / columns) * np.cos(4 * y / rows)
    z += 0.02 * np.random.default_rng(seed).normal(size=z.shape)
    positions = np.stack([x / columns, y / rows, height * z], -1).reshape(-1, 3).astype(np.float32)
    corner = (np.arange(rows)[:, None] * (columns + 1) + np.arange(columns)).reshape(-1, 1)
    quad = corner + np.array([0, 1, columns + 2, 0, columns + 2, columns + 1])
    return positions, quad.reshape(-1).astype(np.uint32)


def shuffled(surface: Grid, seed: int = 1) -> Grid:
    """Return the same triangles in random order, each with three vertices of its own, and 7 vertices never used."""
    positions, indices = surface
    rng = np.random.default_rng(seed)
    corners = rng.permutation(indices.reshape(-1, 3)).reshape(-1)
    order = rng.permutation(len(corners))
    place = np.argsort(order).astype(np.uint32)  # vertex k of the new pool is corner order[k]
    unused = rng.normal(size=(7, 3)).astype(np.float32)
    return np.concatenate([positions[corners][order], unused]), place


def scene_of(
    *surfaces: Grid,
    matrices: tuple[np.ndarray, ...] = (np.eye(4),),
    drawn: tuple[int, ...] = (0,),
    materials: tuple[int, ...] = (),
    kinds: tuple[Material, ...] = (Material(),),
) -> Scene:
    """Return a scene of meshes; instance i has matrix i and shows mesh `drawn[i]`, mesh j has `materials[j]`.

    Normals and tangents depend on the position alone, so vertices are equal where positions are.
    """
    counts = [len(positions) for positions, _ in surfaces]
    lengths = [len(indices) for _, indices in surfaces]
    table = np.zeros(len(surfaces), MESH_DTYPE)
    table["first_vertex"], table["vertex_count"] = np.cumsum(counts) - counts, counts
    table["first_index"], table["index_count"] = np.cumsum(lengths) - lengths, lengths
    table["material"] = materials or 0
    for row, (positions, indices) in zip(table, surfaces, strict=True):
        row["bounds_min"], row["bounds_max"] = positions[indices].min(axis=0), positions[indices].max(axis=0)
    positions = np.concatenate([each for each, _ in surfaces])
    normals = np.stack(
        [np.cos(9 * positions[:, 0]), np.sin(7 * positions[:, 1]), np.full(len(positions), 2)], -1
    )
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    tangents = np.cross(normals, (0.3, 1.0, 0.2))
    tangents /= np.linalg.norm(tangents, axis=1, keepdims=True)
    sign = np.where(positions[:, :1] > 0.5, -1.0, 1.0)
    return replace(
        quad_scene(),
        positions=positions.astype(np.float32),
        normals=normals.astype(np.float32),
        tangents=np.concatenate([tangents, sign], axis=1).astype(np.float32),
        uv0=(positions[:, :2] * 3).astype(np.float32),
        indices=np.concatenate([each for _, each in surfaces]),
        meshes=table,
        mesh_names=[f"mesh {number}" for number in range(len(surfaces))],
        materials=list(kinds),
        nodes=nodes_at(*matrices),
        instances=Instances(np.arange(len(matrices), dtype=np.int32), np.array(drawn, np.int32)),
    )
