"""Meshlets as arrays of a scene cache: cutting them takes longer than all else that a second load does."""

from __future__ import annotations

import numpy as np

from common.errors import SceneError
from common.scene import Scene

from ..meshlets.model import MESHLET, SceneMeshlets
from ..meshlets.scene import keep_meshlets, meshlets_of
from .records import Add, Get


def store_meshlets(scene: Scene, add: Add) -> dict[str, int] | None:
    """Return the numbers of the arrays of a scene's meshlets, after each went to `add`; None if there are none.

    Waits for the meshlets if a thread builds them.
    """
    try:
        meshlets = meshlets_of(scene)
    except SceneError:  # told when the scene is drawn
        return None
    if not len(meshlets.records):
        return None
    return {
        "records": add(meshlets.records.view(np.uint32).reshape(len(meshlets.records), -1)),
        "words": add(meshlets.words),
        "ranges": add(meshlets.ranges),
        "indices": add(meshlets.indices),
    }


def read_meshlets(scene: Scene, stored: dict[str, int] | None, get: Get) -> None:
    """Set the meshlets of a scene to those that `store_meshlets` stored. Raises ValueError if they are not its own."""
    if stored is None:
        return
    records, words, ranges, indices = (
        get(stored[name]) for name in ("records", "words", "ranges", "indices")
    )
    shapes = [(ranges[:, 1].sum(), MESHLET.itemsize // 4), (len(scene.meshes), 2), scene.indices.shape]
    if [records.shape, ranges.shape, indices.shape] != shapes:
        raise ValueError("its meshlets are of another scene")
    keep_meshlets(scene, SceneMeshlets(records.view(MESHLET).reshape(-1), words, ranges, indices))
