"""The light lists in double precision: what a light reaches, and which points of it a camera sees where."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from common.scene import Scene
from common.scene.pose import evaluate_pose
from common.view.camera import View


@dataclass(frozen=True)
class Reach:
    """The lit part of space of one local light: a sphere, or the part of it within a cone."""

    position: np.ndarray
    axis: np.ndarray
    radius: float
    cosine: float
    """Of the half angle; -1 for a point light."""

    def points(self, random: np.random.Generator, count: int) -> np.ndarray:
        """Return up to `count` points (N, 3) of it: inside, on its surface, and on the rim of the cone."""
        directions = random.normal(size=(count, 3))
        directions /= np.linalg.norm(directions, axis=1, keepdims=True)
        if self.cosine > -1.0:
            # Uniform over the cap, and a third of them on the rim.
            z = random.uniform(self.cosine, 1.0, count)
            z[::3] = self.cosine
            across = directions - (directions @ self.axis)[:, None] * self.axis
            across /= np.linalg.norm(across, axis=1, keepdims=True)
            directions = z[:, None] * self.axis + np.sqrt(1 - z * z)[:, None] * across
        far = min(self.radius, 1e4) * random.uniform(0.0, 1.0, count) ** (1 / 3)
        far[::2] = min(self.radius, 1e4)
        found: np.ndarray = self.position + far[:, None] * directions
        return found


def reaches(scene: Scene, cutoff: float) -> list[Reach]:
    """Return what each light that is not directional reaches, in the order of the scene, in world coordinates."""
    pose = evaluate_pose(scene, 0.0)
    found = []
    for light in scene.lights:
        if light.kind == "directional":
            continue
        world = pose.world_from_node[light.node]
        end = np.sqrt(light.intensity * max(light.color) / cutoff) if cutoff > 0 else np.inf
        axis = -world[:3, 2] / np.linalg.norm(world[:3, 2])
        cosine = np.cos(light.outer_cone) if light.kind == "spot" else -1.0
        found.append(Reach(world[:3, 3], axis, min(light.range, end), float(cosine)))
    return found


def seen_at(points: np.ndarray, view: View, size: tuple[int, int]) -> tuple[np.ndarray, np.ndarray]:
    """Return (pixels (N, 2), depths (N,)) of world points; pixels are NaN where a point is not in the picture."""
    width, height = size
    view_from_world = np.linalg.inv(view.world_from_view)
    in_view = np.concatenate([points, np.ones((len(points), 1))], axis=1) @ view_from_world.T
    clip = in_view @ view.projection.clip_from_view(width / height).T
    with np.errstate(divide="ignore", invalid="ignore"):
        ndc = clip[:, :3] / clip[:, 3:]
    pixels = (0.5 * ndc[:, :2] + 0.5) * size
    depths = -in_view[:, 2]
    outside = (clip[:, 3] <= 0) | (np.abs(ndc[:, :2]) >= 1).any(axis=1) | (ndc[:, 2] < 0) | (ndc[:, 2] > 1)
    pixels[outside] = np.nan
    return pixels, depths
