"""A small scene in which everything meets: surfaces of all kinds that pierce one another, under lights of all kinds."""

from __future__ import annotations

import numpy as np

from common.numerics.transforms import pose_looking_at
from common.scene import Image, Light, Material, Scene
from common.view.camera import Perspective, View
from tests.support.scenes import quad_scene, texture

CAMERA = View(pose_looking_at((1.0, 2.0, 4.0), (0.0, 0.0, 0.0)), Perspective(0.7, 0.1))
"""A view of all of it."""

KINDS = (
    Material(
        base_color=(0.7, 0.4, 0.2, 1),
        occlusion_texture=texture(),
        roughness=0.6,
        metallic=0.0,
        double_sided=True,
    ),
    Material(
        base_color_texture=texture(),
        alpha_mode="mask",
        alpha_cutoff=0.6,
        roughness=0.5,
        metallic=0.3,
        double_sided=True,
    ),
    Material(base_color=(0.2, 0.5, 0.9, 0.4), alpha_mode="blend", roughness=0.8, double_sided=True),
    Material(unlit=True, base_color=(0.1, 0.6, 0.3, 1)),
    Material(base_color=(0.9, 0.8, 0.3, 1), emissive=(2.0, 0.5, 0.0), metallic=1.0, roughness=0.5),
)


def jumble(seed: int, kinds: tuple[Material, ...] = KINDS, count: int = 14) -> Scene:
    """Return `count` squares in all directions around the origin, with materials drawn by lot."""
    rng = np.random.default_rng(seed)
    matrices = []
    for _ in range(count):
        matrix = np.eye(4)
        matrix[:3, :3] = np.linalg.qr(rng.normal(size=(3, 3)))[0] * rng.uniform(0.3, 1.0)
        matrix[:3, 3] = rng.uniform(-1.0, 1.0, 3)
        matrices.append(matrix)
    for place in ((3.0, 2.0, 1.0), (-2.0, 3.0, 2.0)):  # where the lights are: squares too small to be seen
        matrix = np.diag((1e-3, 1e-3, 1e-3, 1.0))
        matrix[:3, 3] = place
        matrices.append(matrix)
    return quad_scene(
        materials=kinds,
        matrices=tuple(matrices),
        instance_materials=tuple(rng.integers(0, len(kinds), len(matrices)).tolist()),
        images=(Image("holes", rng.integers(0, 256, (8, 8, 4), np.uint8)),),
        lights=(
            Light("point", node=count, intensity=60.0),
            Light("spot", node=count + 1, intensity=80.0, inner_cone=0.3, outer_cone=1.5),
            Light("directional", node=count + 1, intensity=2.0),
        ),
    )
