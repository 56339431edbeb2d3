"""Instances in a row, one behind the other: what rays hit behind an instance that they pass."""

from __future__ import annotations

from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

import chapters
from common.numerics.transforms import rotation, translation
from tests.support.hierarchies import Tracer, indexed, random_rays, rays_of, soup
from tests.support.kernels import kernels_on
from tests.twins.rays import nearest
from tools.exercises.checking import Given


def check(given: Given) -> None:
    """Random rays through 1, 2 and 30 instances, each tried against every triangle in double precision."""
    model: Any = given.module("rays.bvh.model")
    pack: Any = given.module("rays.bvh.pack")
    corners = soup(24, 7)
    tree = pack.mesh_tree(*indexed(corners))
    with (
        TemporaryDirectory() as folder,
        kernels_on(given.device, chapters.package_of(given.which)) as kernels,
    ):
        tracer = Tracer(kernels, model, Path(folder))
        for count in (1, 2, 30):
            matrices = np.array([placed(number) for number in range(count)], np.float32).astype(np.float64)
            buffers = pack.buffers([tree], matrices, [0] * count)
            origins, directions = random_rays(2000, 5, 6.0)
            rays = rays_of(origins, directions)
            hits = tracer.trace(buffers, rays)
            world = (
                np.einsum("nij,tkj->ntki", matrices[:, :3, :3], np.float64(corners))
                + matrices[:, None, None, :3, 3]
            )
            which, _, sure = nearest(world.reshape(-1, 3, 3), rays[:, :3], rays[:, 4:7])
            expected = np.where(which >= 0, which // len(corners), -1)
            wrong = sure & (hits.instance != expected)
            given.need(
                not wrong.any(),
                f"With {count} instances {int(wrong.sum())} of {int(sure.sum())} rays hit another instance than the "
                "nearest one, or none.",
            )
    given.silent()


def placed(number: int) -> np.ndarray:
    """Return the (4, 4) matrix of an instance: away from the origin, turned, and of its own size."""
    rng = np.random.default_rng(number)
    size = rng.uniform(0.3, 1.5)
    turned = rotation(tuple(rng.normal(size=3)), rng.uniform(0, 6)) @ np.diag((size, size, size, 1.0))
    return translation(tuple(rng.uniform(-5, 5, 3))) @ turned
