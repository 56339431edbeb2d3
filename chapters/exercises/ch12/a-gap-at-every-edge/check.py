"""Rays from the inside of closed meshes, aimed at corners and edges: none may leave."""

from __future__ import annotations

from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

import chapters
from tests.support.hierarchies import Tracer, icosphere, rays_of, torus
from tests.support.kernels import kernels_on
from tools.exercises.checking import Given

INSIDE = {"a sphere": (0.11, -0.07, 0.05), "a ring": (1.02, 0.03, 0.04)}


def check(given: Given) -> None:
    """All corners, middles of edges and places along edges of two meshes, and random directions."""
    model: Any = given.module("rays.bvh.model")
    pack: Any = given.module("rays.bvh.pack")
    with (
        TemporaryDirectory() as folder,
        kernels_on(given.device, chapters.package_of(given.which)) as kernels,
    ):
        tracer = Tracer(kernels, model, Path(folder))
        for name, (positions, triangles) in {"a sphere": icosphere(2), "a ring": torus(16, 8)}.items():
            tree = pack.mesh_tree(positions, np.uint32(triangles).reshape(-1))
            buffers = pack.buffers([tree], np.eye(4)[None], [0])
            origin = np.array(INSIDE[name], np.float32)
            for what, places in aims(positions, triangles).items():
                rays = rays_of(np.tile(origin, (len(places), 1)), np.float32(places - origin))
                leaks = int((~tracer.trace(buffers, rays).hit).sum())
                given.need(
                    leaks == 0,
                    f"Of {len(rays)} rays from the inside of {name} to {what} of it, {leaks} hit nothing.",
                )
    given.silent()


def aims(positions: np.ndarray, triangles: np.ndarray) -> dict[str, np.ndarray]:
    """Return places (N, 3) by what they are."""
    corners = positions[triangles].astype(np.float64)
    rng = np.random.default_rng(3)
    a, b = corners[:, 0], corners[:, 1]
    along = a + (b - a) * rng.random((len(a), 1))
    inner = (corners * rng.dirichlet((1, 1, 1), len(a))[..., None]).sum(axis=1)
    return {
        "places inside triangles": inner,
        "corners": positions.astype(np.float64),
        "middles of edges": (a + b) / 2,
        "places on edges": along,
    }
