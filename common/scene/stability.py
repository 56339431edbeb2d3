"""A scene and its camera moved or scaled together: the picture must stay the same, and how much of it does not.

Float32 knows positions of 1e5 m to 8 mm, so whatever is not computed relative to the scene's origin shows here first.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from common.numerics.transforms import translation
from common.scene import Nodes, Scene
from common.view.camera import Orthographic, Perspective, View

BOUND = 1e-3
"""At most this fraction of pixels may change by more than 1/255: the bound that every chapter holds."""

OFFSETS_M = ((1e5, 0.0, 0.0), (0.0, 1e5, 0.0), (0.0, 0.0, 1e5), (-1e5, 1e5, 1e5))
FACTORS = (1e-3, 1e3)


def cases(scene: Scene, view: View) -> Iterator[tuple[str, Scene, View]]:
    """Give (name, scene, view) of every case: moved by 100 km along each axis, scaled by 1/1000 and 1000."""
    for offset in OFFSETS_M:
        yield f"moved by ({', '.join(f'{x:g}' for x in offset)}) m", *moved(scene, view, offset)
    for factor in FACTORS:
        yield f"scaled by {factor:g}", *scaled(scene, view, factor)


def moved(scene: Scene, view: View, offset: tuple[float, float, float]) -> tuple[Scene, View]:
    """Return scene and view moved by `offset` metres."""
    by = translation(offset)
    medium = None if scene.medium is None else scene.medium.moved(offset)
    drawn = replace(scene, nodes=_under(scene, by), medium=medium)
    return drawn, replace(view, world_from_view=by @ view.world_from_view)


def scaled(scene: Scene, view: View, factor: float) -> tuple[Scene, View]:
    """Return scene and view scaled about zero: lengths times `factor`, candelas times its square, lux unchanged."""
    by = np.diag((factor, factor, factor, 1.0))
    lights = [
        light
        if light.kind == "directional"
        else replace(light, intensity=light.intensity * factor**2, range=light.range * factor)
        for light in scene.lights
    ]
    cameras = [
        replace(camera, near=camera.near * factor, far=camera.far * factor, ymag=camera.ymag * factor)
        for camera in scene.cameras
    ]
    pose = view.world_from_view.copy()
    pose[:3, 3] *= factor
    lens = view.projection
    projection: Perspective | Orthographic
    if isinstance(lens, Perspective):
        projection = replace(lens, near=lens.near * factor)
    else:
        projection = Orthographic(lens.ymag * factor, lens.near * factor, lens.far * factor)
    medium = None if scene.medium is None else scene.medium.scaled(factor)
    changed = replace(scene, nodes=_under(scene, by), lights=lights, cameras=cameras, medium=medium)
    return changed, replace(view, world_from_view=pose, projection=projection)


def _under(scene: Scene, world: NDArray[np.float64]) -> Nodes:
    """Return the scene's nodes below a new root with the matrix `world` (4, 4).

    The new node comes last, so that all indices stay what they are, and roots that are animated stay so.
    """
    nodes = scene.nodes
    count = len(nodes)
    return Nodes(
        parent=np.append(np.where(nodes.parent < 0, count, nodes.parent), -1).astype(np.int32),
        translation=np.vstack([nodes.translation, np.zeros((1, 3))]),
        rotation=np.vstack([nodes.rotation, (0.0, 0.0, 0.0, 1.0)]),
        scale=np.vstack([nodes.scale, np.ones((1, 3))]),
        matrix=np.concatenate([nodes.matrix, world[None]]),
        has_matrix=np.append(nodes.has_matrix, True),
        names=[*nodes.names, "root"],
        weights=nodes.weights,
        extras=nodes.extras,
    )


def pixels_changed(a: NDArray[Any], b: NDArray[Any], step: int = 1) -> float:
    """Return the fraction of pixels (H, W, C) uint8 of which some channel differs by more than `step` of 255."""
    difference = np.abs(a.astype(np.int16) - b.astype(np.int16))
    return float((difference > step).any(axis=-1).mean())
