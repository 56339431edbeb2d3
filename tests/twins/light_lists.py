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


@dataclass(frozen=True)
class Built:
    """The lists as numpy builds them, light by light and tile by tile, in the order of the scene's local lights."""

    middles: np.ndarray
    """(L,) middle of each light's interval of depth."""
    intervals: np.ndarray
    """(L, 2) the interval."""
    tiles: np.ndarray
    """(H, W, L) whether the light's sphere meets the cone around the tile."""


def built(
    scene: Scene, view: View, size: tuple[int, int], cutoff: float, wider: float, tile: int = 8
) -> Built:
    """Return the lists of a perspective view, with all radii longer by the part `wider`."""
    view_from_world = np.linalg.inv(view.world_from_view)
    found = reaches(scene, cutoff)
    apex = np.array([view_from_world @ np.append(it.position, 1.0) for it in found])[:, :3]
    axis = np.array([view_from_world[:3, :3] @ it.axis for it in found])
    reach = np.array([min(it.radius, 1e18) for it in found])
    cosine = np.array([it.cosine for it in found])
    spot = cosine > -1.0
    # The smallest sphere around a cone with a round cap: through apex and rim, or around the rim where that is wider.
    narrow = cosine > np.sqrt(0.5)
    along = np.where(narrow, 0.5 * reach / np.maximum(cosine, 1e-9), reach * cosine)
    around = np.where(narrow, along, reach * np.sqrt(np.maximum(1 - cosine**2, 0)))
    middle = np.where(spot[:, None], apex + along[:, None] * axis, apex)
    radius = np.where(spot, around, reach) * (1 + wider)
    low = np.maximum(-apex[:, 2] - reach * (1 + wider), -middle[:, 2] - radius)
    high = np.minimum(-apex[:, 2] + reach * (1 + wider), -middle[:, 2] + radius)
    across, down = (-(-pixels // tile) for pixels in size)
    view_from_clip = np.linalg.inv(view.projection.clip_from_view(size[0] / size[1]))

    def through(x: np.ndarray, y: np.ndarray) -> np.ndarray:
        ndc = np.stack([2 * x / size[0] - 1, 2 * y / size[1] - 1, np.ones_like(x), np.ones_like(x)], axis=-1)
        point = (ndc @ view_from_clip.T)[..., :3]
        directions: np.ndarray = point / np.linalg.norm(point, axis=-1, keepdims=True)
        return directions

    x, y = np.meshgrid(np.arange(across) * float(tile), np.arange(down) * float(tile))
    centre = through(x + tile / 2, y + tile / 2)
    corners = np.stack([through(x + dx, y + dy) for dx in (0, tile) for dy in (0, tile)])
    half = np.arccos(np.clip((corners * centre).sum(axis=-1), -1, 1)).max(axis=0)
    distance = np.linalg.norm(middle, axis=1)
    angle = np.arcsin(np.clip(radius / distance, 0, 1))
    apart = np.arccos(np.clip(centre @ (middle / distance[:, None]).T, -1, 1))
    meets = (apart <= angle + half[..., None]) | (distance <= radius)
    return Built(0.5 * (low + high), np.stack([low, high], axis=1), meets & (high >= 0))


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
