"""Scenes with many lights of all kinds."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from common.numerics.transforms import pose_looking_at
from common.scene import Light, Scene
from tests.support.scenes import nodes_at
from tests.support.towns import town

KINDS = ("point", "point", "spot")
"""The kinds of local lights, in turn."""


def lamps(count: int, seed: int = 7, directional: int = 0) -> tuple[list[Light], np.ndarray]:
    """Return lights and their poses (L, 4, 4) between the objects of `town`: ranges and cones of all sizes."""
    random = np.random.default_rng(seed)
    lights, poses = [], []
    for number in range(count):
        kind = KINDS[number % len(KINDS)] if number >= directional else "directional"
        outer = float(random.uniform(0.1, np.pi / 2))
        lights.append(
            Light(
                kind,
                node=number,
                color=tuple(random.uniform(0.1, 1.0, 3).tolist()),
                intensity=float(random.uniform(0.2, 3.0)),
                range=np.inf if number % 10 == 0 and number < 100 else float(random.uniform(0.5, 6.0)),
                inner_cone=outer * float(random.uniform(0.0, 0.9)),
                outer_cone=outer,
            )
        )
        eye = random.uniform((-12, -1, -12), (12, 4, 12))
        poses.append(pose_looking_at(eye, eye + random.normal(size=3), (0.3, 0.9, 0.2)))
    return lights, np.array(poses).reshape(-1, 4, 4)


def lit(scene: Scene, lights: list[Light], poses: np.ndarray) -> Scene:
    """Return a scene, all of whose nodes have matrices, with these lights at nodes of their own behind them."""
    first = len(scene.nodes.matrix)
    nodes = nodes_at(*scene.nodes.matrix, *poses)
    moved = [replace(light, node=first + light.node) for light in lights]
    shown = replace(scene, lights=moved, nodes=nodes)
    shown.origin = scene.origin
    return shown


def lit_town(count: int, **options: int) -> Scene:
    """Return the town under lamps alone."""
    return lit(town(), *lamps(count, **options))
