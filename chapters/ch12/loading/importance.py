"""The size of materials on the screen: the largest ones are loaded first."""

from __future__ import annotations

import numpy as np

from common.scene import Scene
from common.view.camera import Perspective, View


def material_sizes(scene: Scene, records: np.ndarray, view: View) -> np.ndarray:
    """Return (M,) the largest radius of the objects of each material, in heights of the picture; 0: none is visible.

    `records` (I,) are the instances' Instance records. The size of an object is that of its bounding
    sphere. A sphere outside the cone around the view counts a tenth: the camera turns faster than files are read.
    """
    sizes = np.zeros(len(scene.materials))
    if not len(records):
        return sizes
    sphere = records["bounds_centre"].astype(np.float64)
    seen = sphere[:, :3] + (scene.origin - view.eye)
    ahead = -(seen @ view.world_from_view[:3, 2])
    radius = sphere[:, 3]
    if isinstance(view.projection, Perspective):
        distance = np.linalg.norm(seen, axis=1)
        reach = np.tan(view.projection.yfov / 2)
        size = radius / (2.0 * reach * np.maximum(distance, np.maximum(radius, view.projection.near)))
        # The cone contains a picture that is twice as wide as high.
        beside = (
            np.sqrt(np.maximum(distance**2 - ahead**2, 0.0)) - 2.3 * reach * np.maximum(ahead, 0.0) > radius
        )
    else:
        size = radius / (2.0 * view.projection.ymag)
        aside = np.sqrt(np.maximum((seen**2).sum(axis=1) - ahead**2, 0.0))
        beside = aside - 2.3 * view.projection.ymag > radius
    outside = beside | (ahead < -radius)
    size = np.where(scene.instances.visible, np.where(outside, 0.1 * size, size), 0.0)
    np.maximum.at(sizes, scene.meshes["material"][scene.instances.mesh], size)
    return sizes
