"""Scenes in a medium, and the froxels of a renderer, read back."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from common.numerics.transforms import pose_looking_at
from common.scene import FogBox, Medium, Scene
from common.scene.pose import evaluate_pose
from common.view.camera import Perspective, View
from tests.support.buffers import read_words
from tests.support.shadows import PLAIN, yard
from tests.twins import fog as twin
from tests.twins.fog_grid import Grid

Float64 = NDArray[np.float64]

SIZE = (64, 48)
GRID = (12, 10, 16)  # no multiple of a work group
FULL: dict[str, Any] = {
    **PLAIN,
    "shadows": "off",
    "fog_format": "rgba32f",
    "fog_columns": GRID[0],
    "fog_rows": GRID[1],
    "fog_slices": GRID[2],
    "fog_anisotropy": 0.6,
    "fog_spatial": False,
    "fog_temporal": False,
    "fog_dither": False,
    "fog_near": 0.03,
    "fog_far": 2.0,
}
"""Settings of a small grid in 32 bits without filters."""

VIEW = View(pose_looking_at((3.0, 2.5, 4.0), (0.0, 0.4, 0.0)), Perspective(0.9, 0.05))

HAZE = Medium(extinction=0.05, albedo=(0.9, 0.8, 0.7))
LAYERS = Medium(
    extinction=0.02,
    height_extinction=0.3,
    height_falloff=1.5,
    height_base=0.2,
    albedo=(0.9, 0.8, 0.7),
    boxes=(FogBox((1.0, 0.8, 1.5), (0.8, 0.7, 0.9), 0.6, (0.2, 0.5, 0.9)),),
)


def foggy(*lights: Any, medium: Medium = HAZE, **more: Any) -> Scene:
    """Return the yard of the tests of shadows, in a medium."""
    return replace(yard(*lights, **more), medium=medium)


def twin_of(medium: Medium) -> twin.Medium:
    """Return the twin of a medium."""
    height = twin.Height(medium.height_extinction, medium.height_falloff, medium.height_base, medium.albedo)
    boxes = tuple(twin.Box(box.center, box.half_size, box.extinction, box.albedo) for box in medium.boxes)
    return twin.Medium(medium.extinction, medium.albedo, height if medium.height_extinction else None, boxes)


def grid_of(renderer: Any, view: View = VIEW) -> Grid:
    """Return the twin of a renderer's grid, in the coordinates of the world."""
    knobs, scale = renderer.settings.fog, renderer.scene.length_scale
    width, height = renderer.size
    size = knobs.fog_columns, knobs.fog_rows, knobs.fog_slices
    return Grid(
        size,
        knobs.fog_near * scale,
        knobs.fog_far * scale,
        view.clip_from_view(width / height),
        view.world_from_view,
    )


def records(renderer: Any) -> tuple[Float64, Float64]:
    """Return (Z, Y, X, 4) fog where each froxel begins, and light and extinction per metre in it."""
    technique = renderer.techniques["fog"]
    words = read_words(renderer.device, technique._memory.store).view(np.uint32)
    columns, rows, slices = technique._block["size"][:3].tolist()
    count, first = columns * rows * slices, 4 * int(technique._block["places"][1])
    if renderer.settings.fog.fog_format == "rgba32f":
        values = words[first : first + 8 * count].view(np.float32)
    else:
        values = words[first : first + 4 * count].view(np.float16)
    values = values.reshape(slices, rows, columns, 8).astype(np.float64)
    return values[..., :4], values[..., 4:]


def radii(grid: Grid) -> Float64:
    """Return (Z, Y, X) half the diagonal of each froxel: nearer lights are not told apart."""
    depth = np.broadcast_to(grid.depths()[:, None, None], grid.size[::-1])
    uvw = grid.centers()
    next_ = uvw + np.array((1 / grid.size[0], 1 / grid.size[1], 0.0))
    here, there = grid.view_from_uvw(uvw, depth), grid.view_from_uvw(next_, depth)
    thick = np.broadcast_to(np.diff(grid.edges())[:, None, None], grid.size[::-1])
    return 0.5 * np.linalg.norm(np.concatenate([(there - here)[..., :2], thick[..., None]], axis=-1), axis=-1)


def apart(grid: Grid, lamps: Any) -> NDArray[np.bool_]:
    """Return (Z, Y, X) whether a froxel's sample is farther from all lamps (points) than half its diagonal."""
    away = [np.linalg.norm(grid.samples() - lamp, axis=-1) for lamp in lamps]
    result: NDArray[np.bool_] = np.min(away, axis=0) > 1.01 * radii(grid)
    return result


def noise_volume(renderer: Any) -> Float64:
    """Return (Z, Y, X) the noise of the medium, as froxels read it."""
    size = renderer.settings.fog.fog_noise_size
    words = read_words(renderer.device, renderer.techniques["fog"]._memory.tables)[128 * 128 :]
    values: Float64 = words.view(np.float16)[: size**3].reshape(size, size, size).astype(np.float64)
    return values


def lights_of(scene: Scene, kind: Callable[[Scene, float, int], Any]) -> np.ndarray:
    """Return the LIGHT records of a scene, as a chapter packs them: `kind` is its LightRecords."""
    records = kind(scene, 0.0, 64)
    records.follow()
    packed: np.ndarray = records.at(evaluate_pose(scene, 0.0))
    return packed


def in_cube(scene: Scene, edge: float = 1.0) -> Callable[[Float64, Float64], NDArray[np.bool_]]:
    """Return whether segments cross the cube of the yard, or one of another edge; places are relative to the origin."""

    def blocked(origins: Float64, targets: Float64) -> NDArray[np.bool_]:
        cube = twin.Box((0.0, 1.0, 0.0), (edge / 2,) * 3, 1.0)
        first, last = twin.crossing(origins + scene.origin, targets - origins, cube)
        crossed: NDArray[np.bool_] = last > first
        return crossed

    return blocked
