"""The faces of directional lights: a fit to the scene, and cascades that follow the view without shimmering.

The last cascade of a light covers the box of the scene. Those before it cover parts of the view, nearer and finer. Each
is a square around the bounding sphere of its part: turning the camera changes the place of the sphere, never its size.
The place is rounded to whole texels, so that a caster meets the same texels in every frame, and its edge stands still.

Source: Valient, "Stable Rendering of Cascaded Shadow Maps", ShaderX6, 2008; the split distances are a mix of equal and
of logarithmic ones (Zhang et al., "Parallel-Split Shadow Maps for Large-scale Virtual Environments", VRCIA 2006).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from common.view.camera import Orthographic, View

from .faces import FACE, axes_of, set_axes

Float64 = NDArray[np.float64]

EVENNESS = 0.15
"""The part of equal distances in the splits; the rest is logarithmic."""

NEAREST_SPLIT = 0.01
"""The least distance of the logarithm's beginning, as a part of the distance that cascades cover."""


DEPTH_MARGIN = 1e-4
"""What depth has beyond the fit at both ends, in diagonals of the scene: rounding must not clip what touches it."""


def corners(bounds: Float64) -> Float64:
    """Return the (8, 3) corners of a box (2, 3)."""
    choice = np.indices((2, 2, 2)).reshape(3, -1).T
    return np.take_along_axis(bounds, choice, axis=0)


def fit(direction: Float64, bounds: Float64) -> tuple[Float64, Float64]:
    """Return the (3, 3) axes of a light that shines along `direction` (3,), and the (2, 3) box of `bounds` along them.

    The box is the tightest: each of its six sides touches a corner of `bounds` (2, 3).
    """
    axes = axes_of(direction[None])[0]
    along = corners(bounds) @ axes.T
    return axes, np.stack([along.min(axis=0), along.max(axis=0)])


def splits(near: float, far: float, parts: int) -> Float64:
    """Return (parts + 1,) distances ahead of the camera at which its cascades begin and end."""
    near = max(near, NEAREST_SPLIT * far)
    step = np.arange(parts + 1) / parts
    distances: Float64 = (
        EVENNESS * (near + (far - near) * step) + (1 - EVENNESS) * near * (far / near) ** step
    )
    distances[0] = 0.0
    return distances


def slice_sphere(view: View, aspect: float, begin: float, end: float) -> tuple[float, float]:
    """Return how far ahead the centre of the smallest sphere around a slice of a view lies, and its radius, metres."""
    projection = view.projection
    if isinstance(projection, Orthographic):
        half = np.hypot(projection.ymag, projection.ymag * aspect)
        return (begin + end) / 2, float(np.hypot(half, (end - begin) / 2))
    k2 = np.tan(projection.yfov / 2) ** 2 * (1 + aspect**2)
    ahead = (begin + end) / 2 * (1 + k2)
    if ahead >= end:  # the corners of the far end are farthest apart
        return end, float(end * np.sqrt(k2))
    return float(ahead), float(np.sqrt((end - ahead) ** 2 + k2 * end**2))


def directional_faces(
    directions: Float64,
    bounds: Float64,
    view: View,
    origin: Float64,
    aspect: float,
    cascades: int,
    size: int,
    guard: int,
) -> np.ndarray:
    """Return (N * cascades,) FACE records of lights that shine along `directions` (N, 3), the finest cascade first.

    `bounds` (2, 3) is the box of the scene relative to its `origin`. Tiles are not placed yet.
    """
    faces = np.zeros(len(directions) * cascades, FACE)
    used = size - 2 * guard
    reach = float(np.linalg.norm(bounds[1] - bounds[0]))
    ends = splits(view.projection.near, reach, cascades)
    eye, back = view.eye - origin, view.world_from_view[:3, 2]
    for number, direction in enumerate(directions):
        axes, box = fit(direction, bounds)
        own = faces[number * cascades : (number + 1) * cascades]
        set_axes(own, np.broadcast_to(axes, (cascades, 3, 3)))
        margin = DEPTH_MARGIN * reach
        depth = box[:, 2] + (-margin, margin)
        for cascade in range(cascades):
            if cascade == cascades - 1:
                extent = np.maximum(box[1, :2] - box[0, :2], 1e-6 * reach)
                scale, middle = used / extent, box[:, :2].mean(axis=0)
            else:
                ahead, radius = slice_sphere(view, aspect, ends[cascade], ends[cascade + 1])
                scale = np.full(2, used / (2 * radius))
                middle = np.round(axes[:2] @ (eye - ahead * back) * scale) / scale
            own["scale_x"][cascade], own["scale_y"][cascade] = scale
            own["origin"][cascade] = np.array([*middle, depth[0]]) @ axes
        own["far"] = depth[1] - depth[0]
    faces["guard"], faces["size"] = guard, size
    return faces
