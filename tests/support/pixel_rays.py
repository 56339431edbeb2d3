"""The rays through the middles of pixels, in float64 and from the lens alone: for tests of what is seen along them."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from common.view.camera import Perspective, View


def pixel_rays(view: View, size: tuple[int, int]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the eye (3,) of a perspective view and unit directions (H * W, 3), row 0 on top."""
    assert isinstance(view.projection, Perspective)
    y, x = np.mgrid[: size[1], : size[0]].reshape(2, -1) + 0.5
    slope = math.tan(view.projection.yfov / 2)
    right, up = (2 * x / size[0] - 1) * slope * size[0] / size[1], (1 - 2 * y / size[1]) * slope
    seen = np.stack([right, up, -np.ones_like(x)])
    along = view.world_from_view[:3, :3] @ (seen / np.linalg.norm(seen, axis=0))
    return view.world_from_view[:3, 3], along.T
