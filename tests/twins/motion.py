"""Motion vectors in float64: a ray through each pixel meets a triangle, and the same point of it is seen before.

Nothing here knows the chapter's matrices: a ray starts at the camera's pose, and the projection is a division by the
distance ahead. All arrays are float64; the picture has row 0 on top.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from common.view.camera import Perspective, View

Float64 = NDArray[np.float64]

HALF = 2.0**-11
"""The largest relative error of a half float."""


def extent(view: View, size: tuple[int, int]) -> Float64:
    """Return (2,) half the width and height of the picture, at distance 1 or of an orthographic view."""
    width, height = size
    lens = view.projection
    half = np.tan(lens.yfov / 2) if isinstance(lens, Perspective) else lens.ymag
    return np.array((half * width / height, half))


def centres(size: tuple[int, int], jitter: tuple[float, float]) -> tuple[Float64, Float64]:
    """Return x and y (H, W) of pixel centres in a picture without jitter, which is in pixels, right and down."""
    y, x = np.indices((size[1], size[0])) + 0.5
    return x - jitter[0], y - jitter[1]


def rays(
    view: View, size: tuple[int, int], jitter: tuple[float, float] = (0.0, 0.0)
) -> tuple[Float64, Float64]:
    """Return the origins and directions (H, W, 3) of the rays through the pixels' centres."""
    width, height = size
    x, y = centres(size, jitter)
    half = extent(view, size)
    across, up = (2 * x / width - 1) * half[0], (1 - 2 * y / height) * half[1]
    zero, one = np.zeros_like(x), np.ones_like(x)
    pose = np.asarray(view.world_from_view, np.float64)
    if isinstance(view.projection, Perspective):
        return np.broadcast_to(pose[:3, 3], (height, width, 3)), np.stack([across, up, -one], -1) @ pose[
            :3, :3
        ].T
    origins = np.stack([across, up, zero], -1) @ pose[:3, :3].T + pose[:3, 3]
    return origins, np.broadcast_to(-pose[:3, 2], (height, width, 3))


def seen_at(view: View, size: tuple[int, int], points: Float64, w: float = 1.0) -> tuple[Float64, Float64]:
    """Return the uv (..., 2) at which a view sees points (..., 3), and how far ahead they are; `w` 0: directions."""
    pose = np.asarray(view.world_from_view, np.float64)
    inside = (points - w * pose[:3, 3]) @ pose[:3, :3]
    ahead = -inside[..., 2] if isinstance(view.projection, Perspective) else np.ones(inside.shape[:-1])
    with np.errstate(divide="ignore", invalid="ignore"):
        scaled = inside[..., :2] / (ahead[..., None] * extent(view, size))
    return 0.5 + 0.5 * scaled * (1.0, -1.0), ahead


def motion(
    view: View,
    before: View,
    size: tuple[int, int],
    now: Float64,
    then: Float64,
    jitter: tuple[float, float] = (0.0, 0.0),
) -> tuple[Float64, NDArray[np.intp], NDArray[np.bool_]]:
    """Return (H, W, 2) motion in uv units, (H, W) the triangle that is seen, -1 for the sky, and which are certain.

    `now` and `then` (T, 3, 3) are the corners of all triangles in this frame and the one before. A pixel is uncertain
    near an edge of its triangle or next to another surface at the same distance. `jitter` is that of this frame.
    """
    origins, directions = rays(view, size, jitter)
    nearest = np.full(origins.shape[:2], np.inf)
    owner = np.full(origins.shape[:2], -1)
    previous = np.array(directions)
    certain = np.ones(origins.shape[:2], bool)
    for number, (corners, moved) in enumerate(zip(now, then, strict=True)):
        edges = corners[1:] - corners[0]
        across = np.cross(directions, edges[1])
        scale = across @ edges[0]
        with np.errstate(divide="ignore", invalid="ignore"):
            u = ((origins - corners[0]) * across).sum(-1) / scale
            turned = np.cross(origins - corners[0], edges[0])
            v = (directions * turned).sum(-1) / scale
            t = turned @ edges[1] / scale
        inside = np.minimum(np.minimum(u, v), 1 - u - v)
        hit = (inside >= 0) & (t > 0) & (t < nearest)
        certain &= ~((np.abs(inside) < 1e-4) & (t > 0) & (t < nearest * (1 + 1e-4)))
        nearest[hit], owner[hit] = t[hit], number
        weights = np.stack([1 - u - v, u, v], axis=-1)
        previous[hit] = weights[hit] @ moved
    width, height = size
    x, y = centres(size, jitter)
    here = np.stack([x / width, y / height], axis=-1)
    there, _ = seen_at(before, size, previous)
    sky, _ = seen_at(before, size, directions, 0.0)
    there = np.where((owner >= 0)[..., None], there, sky)
    vectors = here - there
    if not isinstance(view.projection, Perspective):
        vectors[owner < 0] = 0.0
    return vectors, owner, certain
