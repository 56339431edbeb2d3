"""Scenes of transparent squares, unlit, in an orthographic view: what a pixel shows follows from their planes alone."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from common.numerics.transforms import translation
from common.scene import Material, Scene
from common.view.camera import View
from tests.support.scenes import facing, quad_scene

DISTANCE = 4.0
BEHIND = 0.02
"""The grey of the background."""


def view() -> View:
    """Return a view along -z that shows y from -1 to 1; its exposure is 1, so colours are those of the target."""
    return facing(DISTANCE, ev100=-math.log2(1.2))


def panes(matrices: np.ndarray, colors: np.ndarray) -> Scene:
    """Return squares with (N, 4, 4) `matrices` and (N, 4) `colors` with opacity."""
    shades, shade_of = np.unique(np.asarray(colors), axis=0, return_inverse=True)
    return quad_scene(
        materials=tuple(
            Material(base_color=tuple(shade), alpha_mode="blend", double_sided=True, unlit=True)
            for shade in shades.tolist()
        ),
        matrices=tuple(np.asarray(matrices, np.float64)),
        instance_materials=tuple(shade_of.reshape(-1).tolist()),
    )


def stack(depths: np.ndarray, scale: float = 2.0) -> np.ndarray:
    """Return the matrices of squares that face the view at these heights, each `scale` times its size."""
    matrices = np.stack([translation((0.0, 0.0, z)) for z in depths])
    matrices[:, :2, :2] *= scale
    return matrices


def tilted(seed: int, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Return matrices and colours of squares in all directions that pierce one another."""
    rng = np.random.default_rng(seed)
    matrices = np.tile(np.eye(4), (count, 1, 1))
    for matrix in matrices:
        while True:
            turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
            if abs(np.linalg.det(turn[:2, :2])) > 0.2:  # not seen from its edge
                break
        matrix[:3, :3] = turn * rng.uniform(0.3, 1.2)
        matrix[:3, 3] = rng.uniform(-0.6, 0.6, 3)
    return matrices, random_colors(rng, count)


def random_colors(rng: np.random.Generator, count: int) -> np.ndarray:
    """Return (count, 4) colours that single precision holds, with opacities from 0.1 to 0.9."""
    colors = np.column_stack([rng.uniform(0.0, 1.0, (count, 3)), rng.uniform(0.1, 0.9, count)])
    return colors.astype(np.float32).astype(np.float64)


def with_indices(scene: Scene, indices: np.ndarray) -> Scene:
    """Return a scene with other triangles."""
    return replace(scene, indices=np.asarray(indices, np.uint32))
