"""Motion vectors of rendered frames, and what they are compared with."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from common.scene import Scene
from common.scene.pose import evaluate_pose
from common.view.camera import View
from tests.support.chapter import Chapter
from tests.twins.motion import HALF

SIZE = (64, 48)
LOOSE_PX = 1e-3
"""Float32 positions and depth, beyond the rounding of halves: up to 6e-6 pixels on llvmpipe and lavapipe."""

Float64 = NDArray[np.float64]


def motions(
    chapter: Chapter,
    scene: Scene,
    views: Sequence[View],
    times: Sequence[float] | None = None,
    size: tuple[int, int] = SIZE,
    settings: Any = None,
    **more: Any,
) -> list[np.ndarray]:
    """Return (H, W, 2) float32 motion of a frame for each view."""
    seen = []
    with chapter.open(scene, size, settings, outputs={"motion"}, **more) as renderer:
        for view, time in zip(views, times or [0.0] * len(views), strict=True):
            seen.append(renderer.render(view, time).image("motion"))
    return seen


def triangles_of(scene: Scene, time: float = 0.0) -> Float64:
    """Return (T, 3, 3) the corners of all triangles of rigid instances, in the world, at a time."""
    pose = evaluate_pose(scene, time)
    corners = []
    for mesh, world in zip(scene.instances.mesh.tolist(), pose.world_from_object, strict=True):
        row = scene.meshes[mesh]
        first, vertex = int(row["first_index"]), int(row["first_vertex"])
        own = scene.indices[first : first + int(row["index_count"])] + vertex
        points = scene.positions[own].astype(np.float64) @ world[:3, :3].T + world[:3, 3]
        corners.append(points.reshape(-1, 3, 3))
    return np.concatenate(corners)


def errors_px(seen: np.ndarray, truth: Float64) -> Float64:
    """Return (H, W) the distance in pixels beyond the rounding of half floats."""
    size = np.array(seen.shape[1::-1])
    beyond = np.abs(seen - truth) - np.abs(truth) * HALF - 2.0**-25
    return np.asarray((np.maximum(beyond, 0.0) * size).max(axis=-1))


def assert_close(
    seen: np.ndarray, truth: Float64, owner: np.ndarray, certain: NDArray[np.bool_], loose: float = LOOSE_PX
) -> None:
    """Fail unless vectors are those of the twin wherever it is certain, and that is nearly everywhere.

    A vector longer than twice the picture must come from outside of the picture, too; how far is of no use to anyone.
    """
    assert seen.dtype == np.float32 and np.isfinite(seen).all()
    near = (np.abs(truth) < 2.0).all(axis=-1)
    shown = certain & near
    assert certain.mean() > 0.9 and near.mean() > 0.5
    assert (np.abs(seen[certain & ~near]) > 1.0).any(axis=-1).all()
    worst = errors_px(seen, truth)
    assert worst[shown].max() < loose, np.argwhere(shown & (worst >= loose))[:8]
