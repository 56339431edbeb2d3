"""Surfaces that are cut into meshlets in tests, and the meshlets of the package meshoptimizer to compare with."""

from __future__ import annotations

import ctypes
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import NamedTuple

import numpy as np

from common.scene import Scene
from tests.support.meshes import Grid, grid, shuffled


def sphere(rows: int) -> Grid:
    """Return a unit sphere of 4 `rows`^2 triangles that faces outwards; at the poles `rows` of them have no area."""
    positions, indices = grid(rows, 2 * rows)
    theta, phi = np.pi * positions[:, 1].astype(float), -2 * np.pi * positions[:, 0].astype(float)
    ring = np.sin(theta)
    places = np.stack([ring * np.cos(phi), np.cos(theta), ring * np.sin(phi)], axis=1)
    return places.astype(np.float32), indices.reshape(-1, 3)[:, ::-1].reshape(-1).copy()


def soup(triangles: int, seed: int = 0) -> Grid:
    """Return triangles of random corners in the unit cube, of which each third shares vertices with others."""
    rng = np.random.default_rng(seed)
    indices = np.arange(3 * triangles, dtype=np.uint32).reshape(-1, 3)
    shared = rng.random(triangles) < 1 / 3
    indices[shared] = rng.integers(0, 3 * triangles, (int(shared.sum()), 3))
    return rng.random((3 * triangles, 3)).astype(np.float32), indices.reshape(-1)


def slivers(count: int) -> Grid:
    """Return needles, 1e5 times as long as they are wide, in all directions, and as many triangles without area."""
    rng = np.random.default_rng(5)
    start = rng.random((count, 3))
    along, across = rng.normal(size=(2, count, 3))
    needles = np.stack([start, start + along, start + along / 2 + 1e-5 * across], axis=1)
    lines = np.stack([start, start + along, start + 2 * along], axis=1)
    lines[::2, 2] = lines[::2, 1]
    positions = np.concatenate([needles, lines]).reshape(-1, 3).astype(np.float32)
    return positions, np.arange(len(positions), dtype=np.uint32)


def doubled(surface: Grid) -> Grid:
    """Return a surface with each triangle twice, and a third time with its vertices in another order."""
    positions, indices = surface
    triangles = indices.reshape(-1, 3)
    return positions, np.concatenate([triangles, triangles, triangles[:, [1, 2, 0]]]).reshape(-1)


def holed(surface: Grid) -> Grid:
    """Return a surface in which some vertices are NaN or infinite."""
    positions = surface[0].copy()
    positions[::97] = np.nan
    positions[41::211, 1] = np.inf
    positions[13::307, 2] = -np.inf
    return positions, surface[1]


def placed(surface: Grid, scale: float = 1.0, offset: float = 0.0) -> Grid:
    """Return a surface that is scaled, and then moved along x and z."""
    return (surface[0] * scale + np.array([offset, 0, -offset])).astype(np.float32), surface[1]


SURFACES = {
    "grid": grid(30, 40),
    "sphere": sphere(24),
    "soup": soup(1500),
    "unshared": shuffled(grid(20, 20)),
    "slivers": slivers(300),
    "doubled": doubled(sphere(12)),
    "holed": holed(grid(30, 30)),
    "small": placed(sphere(16), 1e-3),
    "large": placed(sphere(16), 1e3),
    "far": placed(sphere(16), 1.0, 1e5),
    "one place": (np.ones((400, 3), np.float32), np.arange(399, dtype=np.uint32)),
    "one vertex": (np.zeros((1, 3), np.float32), np.zeros(600, np.uint32)),
}
"""What a builder of meshlets has to cope with, by name; each needs more than one meshlet of 64 and 124."""


def triangles_of(scene: Scene, mesh: int, indices: np.ndarray) -> np.ndarray:
    """Return the triangles (T, 3) of a mesh by some indices of the scene."""
    row = scene.meshes[mesh]
    first = int(row["first_index"])
    return indices[first : first + int(row["index_count"])].reshape(-1, 3)


# --- meshoptimizer ---


class Theirs(NamedTuple):
    """Meshlets of meshoptimizer: triangles (K,), cutoffs (K,) of cones in 1/127, and the bound of their number."""

    triangles: np.ndarray
    cutoffs: np.ndarray
    bound: int


class _Bounds(ctypes.Structure):
    _fields_ = (
        ("center", ctypes.c_float * 3),
        ("radius", ctypes.c_float),
        ("apex", ctypes.c_float * 3),
        ("axis", ctypes.c_float * 3),
        ("cutoff", ctypes.c_float),
        ("axis_s8", ctypes.c_int8 * 3),
        ("cutoff_s8", ctypes.c_int8),
    )


@cache
def _library() -> ctypes.CDLL:
    """Return the shared library of the package, whose Python part has no meshlets."""
    import meshoptimizer

    folder = Path(meshoptimizer.__file__).parent
    library = ctypes.CDLL(str(next(folder.glob("_meshoptimizer*.so"))))
    size, place = ctypes.c_size_t, ctypes.c_void_p
    library.meshopt_buildMeshletsBound.argtypes = [size, size, size]
    library.meshopt_buildMeshletsBound.restype = size
    library.meshopt_buildMeshlets.argtypes = [*[place] * 4, size, place, *[size] * 4, ctypes.c_float]
    library.meshopt_buildMeshlets.restype = size
    library.meshopt_computeMeshletBounds.argtypes = [place, place, size, place, size, size]
    library.meshopt_computeMeshletBounds.restype = _Bounds
    return library


def theirs(positions: np.ndarray, indices: np.ndarray, vertices: int = 64, triangles: int = 124) -> Theirs:
    """Return what meshoptimizer makes of a surface."""
    library = _library()
    positions = np.ascontiguousarray(positions, np.float32)
    indices = np.ascontiguousarray(indices, np.uint32)
    bound = library.meshopt_buildMeshletsBound(len(indices), vertices, triangles)
    records = np.zeros((bound, 4), np.uint32)  # first vertex, first corner, vertices, triangles
    used, local = np.zeros(bound * vertices, np.uint32), np.zeros(3 * bound * triangles + 4, np.uint8)
    count = library.meshopt_buildMeshlets(
        *(array.ctypes.data for array in (records, used, local, indices)),
        len(indices),
        positions.ctypes.data,
        len(positions),
        12,
        vertices,
        triangles,
        0.0,
    )
    records = records[:count]
    cutoffs = [
        library.meshopt_computeMeshletBounds(
            used[first:].ctypes.data,
            local[corner:].ctypes.data,
            number,
            positions.ctypes.data,
            len(positions),
            12,
        ).cutoff_s8
        for first, corner, _, number in records.tolist()
    ]
    return Theirs(records[:, 3], np.array(cutoffs), bound)


def theirs_of_scene(scene: Scene, meshes: np.ndarray) -> Iterator[Theirs]:
    """Return what meshoptimizer makes of some meshes of a scene."""
    for mesh in meshes.tolist():
        row = scene.meshes[mesh]
        first = int(row["first_vertex"])
        positions = scene.positions[first : first + int(row["vertex_count"])]
        yield theirs(positions, triangles_of(scene, mesh, scene.indices).reshape(-1))
