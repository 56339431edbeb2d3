"""The faces of directional lights: a fit to the scene, and cascades that follow the view without shimmering.

The last cascade of a light covers the box of the scene. Those before it cover parts of the view, nearer and finer. Each
is a square around the bounding sphere of its part: turning the camera changes the place of the sphere, never its size.
The place is rounded to steps of whole texels. A caster meets the same texels in every frame, so its edge stands still,
and a cascade is drawn anew only when the camera has moved by a step.

Source: Valient, "Stable Rendering of Cascaded Shadow Maps", ShaderX6, 2008; the split distances are a mix of equal and
of logarithmic ones (Zhang et al., "Parallel-Split Shadow Maps for Large-scale Virtual Environments", VRCIA 2006).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from common.view.camera import Orthographic, Projection, View

from .faces import FACE, axes_of

Float64 = NDArray[np.float64]

EVENNESS = 0.15
"""The part of equal distances in the splits; the rest is logarithmic."""

NEAREST_SPLIT = 0.01
"""The least distance of the logarithm's beginning, as a part of the distance that cascades cover."""


STEPS = 16
"""Steps by which a cascade follows the view, along its side: it is wider by one of them, and drawn anew after each."""

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


def slice_sphere(lens: Projection, aspect: float, begin: float, end: float) -> tuple[float, float]:
    """Return how far ahead the centre of the smallest sphere around a slice of a view lies, and its radius, metres."""
    if isinstance(lens, Orthographic):
        half = np.hypot(lens.ymag, lens.ymag * aspect)
        return (begin + end) / 2, float(np.hypot(half, (end - begin) / 2))
    k2 = np.tan(lens.yfov / 2) ** 2 * (1 + aspect**2)
    ahead = (begin + end) / 2 * (1 + k2)
    if ahead >= end:  # the corners of the far end are farthest apart
        return end, float(end * np.sqrt(k2))
    return float(ahead), float(np.sqrt((end - ahead) ** 2 + k2 * end**2))


class Cascades:
    """The faces of some directional lights, for all views with one lens. Only places are left to compute for a view.

    `directions` (N, 3) are unit vectors in which the lights shine, `bounds` (2, 3) is the box of the scene relative to
    its `origin`; each light has `count` cascades of `size` texels, the finest first. Tiles are not placed.
    """

    def __init__(
        self,
        directions: Float64,
        bounds: Float64,
        lens: Projection,
        aspect: float,
        origin: Float64,
        count: int,
        size: int,
        guard: int,
    ) -> None:
        self._origin, self._following = origin, count - 1
        used = size - 2 * guard
        reach = max(float(np.linalg.norm(bounds[1] - bounds[0])), 1e-30)
        ends = splits(lens.near, reach, count)
        spheres = [slice_sphere(lens, aspect, ends[k], ends[k + 1]) for k in range(count - 1)]
        self._ahead, radii = np.array(spheres).reshape(-1, 2).T
        self._step = max(1, used // STEPS)
        self._scale = (used - self._step) / (2 * radii)
        faces = self._faces = np.zeros((len(directions), count), FACE)
        self._axes = np.zeros((len(directions), 3, 3))
        self._depth = np.zeros(len(directions))
        margin = DEPTH_MARGIN * reach
        for number, direction in enumerate(directions):
            axes, box = fit(direction, bounds)
            self._axes[number], self._depth[number] = axes, box[0, 2] - margin
            last = faces[number, -1]
            extent = np.maximum(box[1, :2] - box[0, :2], 1e-6 * reach)
            last["scale_x"], last["scale_y"] = used / extent
            last["origin"] = np.array([*box[:, :2].mean(axis=0), self._depth[number]]) @ axes
            faces["far"][number] = box[1, 2] + margin - self._depth[number]
        for column, name in enumerate(("right", "down", "ahead")):
            faces[name] = self._axes[:, None, column]
        faces["scale_x"][:, :-1] = faces["scale_y"][:, :-1] = self._scale
        faces["guard"], faces["size"] = guard, size
        self._texels: Float64 | None = None

    def at(self, view: View) -> np.ndarray | None:
        """Return the (N * count,) FACE records for a view; None if they are those of the last view."""
        if self._texels is not None and not self._following:
            return None
        eye, back = view.eye - self._origin, view.world_from_view[:3, 2]
        centres = eye - self._ahead[:, None] * back  # (count - 1, 3)
        steps = np.einsum("nij,cj->nci", self._axes[:, :2], centres) * self._scale[:, None] / self._step
        texels = np.round(steps) * self._step
        if self._texels is not None and np.array_equal(texels, self._texels):
            return None
        self._texels = texels
        place = np.empty((*texels.shape[:2], 3))
        place[..., :2], place[..., 2] = texels / self._scale[:, None], self._depth[:, None]
        self._faces["origin"][:, :-1] = np.einsum("nci,nij->ncj", place, self._axes)
        return self._faces.reshape(-1).copy()


def directional_faces(
    directions: Float64,
    bounds: Float64,
    view: View,
    origin: Float64,
    aspect: float,
    count: int,
    size: int,
    guard: int,
) -> np.ndarray:
    """Return the (N * count,) FACE records of lights for one view; see `Cascades`."""
    records = Cascades(directions, bounds, view.projection, aspect, origin, count, size, guard).at(view)
    assert records is not None, "the first view has records"
    return records
