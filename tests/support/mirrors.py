"""A mirror floor and a wall that it shows, and where a camera sees the mirrored wall, worked out on paper."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from common.environment import Environment
from common.numerics.transforms import pose_looking_at, rotation
from common.scene import Material, Scene
from common.view.camera import Orthographic, Perspective, View
from tests.support.scenes import quad_scene, translated
from tests.twins import screen_reflections as twin

MIRROR = Material("mirror", roughness=0.0)
FLOOR = rotation((1, 0, 0), -np.pi / 2) @ np.diag((8.0, 8.0, 1.0, 1.0))
LEVEL = View(pose_looking_at((0.3, 1.1, 4.0), (0.3, 1.1, 0.0)), Perspective(0.9, 0.05))
PITCHED = View(pose_looking_at((-0.8, 1.6, 4.0), (0.4, 0.5, 0.0)), Perspective(0.9, 0.05))
DIM = replace(PITCHED, ev100=PITCHED.ev100 + 1.0)
FLAT = View(pose_looking_at((0.0, 2.0, 5.0), (0.0, 0.6, 0.0)), Orthographic(2.2, 0.1, 20.0))

ODD = {
    "along the floor": ((0.0, 1e-3, 3.0), (0.0, 0.0, -3.0)),
    "straight down, back to the eye": ((0.0, 2.0, 0.5), (0.0, 0.0, 0.5)),
    "nothing but sky": ((0.0, 1.0, 3.0), (0.0, 9.0, 3.1)),
    "the wall at the near plane": ((0.2, 0.8, -0.93), (0.2, 0.8, -1.0)),
    "from below": ((0.0, -1.0, 3.0), (0.0, 0.5, 0.0)),
}
"""Eyes and targets of views at the edge of what a march can do."""


def emitting(color: tuple[float, float, float] = (0.5, 0.25, 0.75)) -> Material:
    """Return a surface of this light that nothing lights; exposure is 1 in these views."""
    return Material("lamp", (0.0, 0.0, 0.0, 1.0), 0.0, 1.0, emissive=color)


def mirror_and_wall(
    turn: float = 0.0,
    floor: Material = MIRROR,
    wall: Material | None = None,
    environment: Environment | None = None,
) -> tuple[Scene, np.ndarray]:
    """Return a square floor at y = 0, and a wall 3 m wide and 1.6 m high, turned about the vertical, at z = -1."""
    place = translated(0.2, 0.8, -1.0) @ rotation((0, 1, 0), turn) @ np.diag((1.5, 0.8, 1.0, 1.0))
    scene = quad_scene(
        materials=(floor, wall or emitting()), matrices=(FLOOR, place), instance_materials=(0, 1)
    )
    return replace(scene, environment=environment), place


def mirror_of(
    view: View, size: tuple[int, int], place: np.ndarray
) -> tuple[np.ndarray, twin.Rays, np.ndarray, np.ndarray]:
    """Return pixels that look down on the floor, their rays, and what they mirror: pixels, wall coordinates (N, 2)."""
    width, height = size
    rows, columns = np.mgrid[:height, :width].reshape(2, -1)
    pixels = np.column_stack([columns, rows]) + 0.5
    near, far = (twin.world_at(pixels, np.full(len(pixels), d), view, size) for d in (1.0, 0.02))
    down = (far - near) / np.linalg.norm(far - near, axis=1, keepdims=True)
    seen = down[:, 1] < -1e-6
    t = -near[seen, 1] / down[seen, 1]
    points, down, pixels = near[seen] + t[:, None] * down[seen], down[seen], pixels[seen]
    up = down * (1.0, -1.0, 1.0)
    normal, middle = place[:3, 2] / np.linalg.norm(place[:3, 2]), place[:3, 3]
    ahead = up @ normal
    t = np.where(ahead < -1e-6, ((middle - points) @ normal) / np.where(ahead < -1e-6, ahead, 1.0), -1.0)
    met = points + t[:, None] * up
    inside = np.column_stack([met, np.ones(len(met))]) @ np.linalg.inv(place).T
    wall = np.where((t > 0)[:, None], inside[:, :2], np.inf)
    depth = twin.seen_at(points, view, size)[:, 2]
    rays = twin.mirrored(pixels, depth, np.tile((0.0, 1.0, 0.0), (len(pixels), 1)), view, size)
    return pixels.astype(int), rays, twin.seen_at(met, view, size)[:, :2], wall


def on_wall(
    depth: np.ndarray, u: int, v: int, view: View, size: tuple[int, int], place: np.ndarray
) -> np.ndarray:
    """Return whether each of the depths (R, C) around pixel (u, v) is that of the wall's plane."""
    rows, columns = np.mgrid[: depth.shape[0], : depth.shape[1]].reshape(2, -1)
    pixels = np.column_stack([columns + max(u - 1, 0), rows + max(v - 1, 0)]) + 0.5
    points = twin.world_at(pixels, np.maximum(depth.ravel(), 1e-9), view, size)
    normal = place[:3, 2] / np.linalg.norm(place[:3, 2])
    return np.abs((points - place[:3, 3]) @ normal) < 1e-2
