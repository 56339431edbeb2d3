"""Frustum culling of boxes on the CPU, vectorised: what the kernels do for one box, for all boxes of a scene at once.

A box is outside if one plane of the frustum has all of its corners on the outer side. That test is never wrong about
what it culls, but a large box near an edge of the frustum can be outside without any plane that says so. Most of these
are found by the same test with exchanged roles: all corners of the frustum lie beyond one face of the box (Quilez 2013,
"Correct frustum culling").
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from common.numerics.transforms import frustum_corners, frustum_planes

Float64 = NDArray[np.float64]
Bool = NDArray[np.bool_]

MARGIN = 1e-12
"""Relative error of a distance in float64: a box that touches the frustum stays visible."""


def visible_boxes(boxes_min: ArrayLike, boxes_max: ArrayLike, clip_from_world: ArrayLike) -> Bool:
    """Return (N,) whether boxes with corners (N, 3) and (N, 3) may be seen through `clip_from_world` (4, 4).

    False means that the box is outside for certain. Boxes that touch the frustum are visible, and boxes with a NaN.
    """
    low, high = np.asarray(boxes_min, np.float64), np.asarray(boxes_max, np.float64)
    planes = frustum_planes(clip_from_world)
    outside = _outside_planes(low, high, planes)
    outside |= _beyond_faces(low, high, *_points_and_directions(clip_from_world, planes))
    return ~outside


def _outside_planes(low: Float64, high: Float64, planes: Float64) -> Bool:
    """Return (N,) whether all corners of a box are outside of one of the planes (P, 4).

    The corner farthest along a normal is that of the box's upper end where the normal's component is positive.
    """
    normals, offsets = planes[:, :3], planes[:, 3]
    upper, lower = np.maximum(normals, 0.0), np.minimum(normals, 0.0)
    # An infinite box gives NaN for some planes, as a box with a NaN does for all; then no comparison holds.
    with np.errstate(invalid="ignore"):
        farthest = high @ upper.T + low @ lower.T + offsets
    size = np.maximum(np.abs(low), np.abs(high)).sum(axis=1)[:, None] + np.abs(offsets)
    outside: Bool = (farthest < -MARGIN * size).any(axis=1)
    return outside


def _points_and_directions(clip_from_world: ArrayLike, planes: Float64) -> tuple[Float64, Float64]:
    """Return points (K, 3) and directions (D, 3): the frustum is their hull, its directions leading to infinity.

    A finite frustum has eight corners. An infinite one has the four of its near plane and the four edges between its
    side planes, along which it is inside of the near plane.
    """
    if len(planes) == 6:
        return frustum_corners(clip_from_world), np.zeros((0, 3))
    sides = planes[:, :3]
    edges = np.array([np.cross(sides[across], sides[along]) for across in (0, 1) for along in (2, 3)])
    edges *= np.sign(edges @ sides[4])[:, None]
    return frustum_corners(clip_from_world, far_ndc=0.5)[:4], edges


def _beyond_faces(low: Float64, high: Float64, points: Float64, directions: Float64) -> Bool:
    """Return (N,) whether the whole frustum lies beyond one face of a box.

    All points of the frustum have to be beyond the face, and no direction may lead back.
    """
    outside = np.zeros(len(low), bool)
    known = ~np.isnan(low).any(axis=1) & ~np.isnan(high).any(axis=1)
    for axis in range(3):
        size = MARGIN * np.abs(points[:, axis]).max()
        for face, sign in ((high[:, axis], 1.0), (low[:, axis], -1.0)):
            if (sign * directions[:, axis] >= 0.0).all():
                nearest = (sign * points[:, axis]).min()
                outside |= nearest - sign * face > MARGIN * np.abs(face) + size
    return outside & known
