"""Truths for `shaders/bounds.glsl` and for culling, in float64: from points of surfaces, not from formulas of bounds.

Matrices act on columns (`common.numerics.transforms`). Everything broadcasts over leading axes where it says so.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from common.numerics.transforms import frustum_planes

Float64 = NDArray[np.float64]
Bool = NDArray[np.bool_]


def unit_sphere(count: int) -> Float64:
    """Return `count` points (count, 3) spread evenly over the unit sphere (a Fibonacci lattice)."""
    number = np.arange(count) + 0.5
    height, turn = 1 - 2 * number / count, np.pi * (1 + np.sqrt(5)) * number
    across = np.sqrt(1 - height**2)
    return np.stack([across * np.cos(turn), across * np.sin(turn), height], axis=-1)


def sphere_extremes(
    centre: ArrayLike, radius: ArrayLike, clip_from_view: ArrayLike
) -> tuple[Float64, Float64]:
    """Return the lowest and the highest ndc (N, 3) of the surfaces of spheres (N, 3), (N,), each coordinate by itself.

    The surface is sampled, then the neighbourhood of the best sample again and again, more densely: what a sampling
    misses is of second order in the distance of its points, and becomes 1e-9 of the sphere.
    """
    centre, radius = np.asarray(centre, np.float64), np.asarray(radius, np.float64)
    first, near = unit_sphere(1500), unit_sphere(150)
    found = []
    for axis in range(3):
        for sign in (-1.0, 1.0):
            tried = np.broadcast_to(first, (len(centre), *first.shape))
            for reach in (0.12, 0.02, 3e-3, 5e-4, 0.0):
                ndc = ndc_of(centre[:, None] + radius[:, None, None] * tried, clip_from_view)[..., axis]
                best = np.argmax(sign * ndc, axis=1)
                direction = np.take_along_axis(tried, best[:, None, None], axis=1)
                tried = direction + reach * near
                tried = np.concatenate(
                    [direction, tried / np.linalg.norm(tried, axis=2, keepdims=True)], axis=1
                )
            found.append(np.take_along_axis(ndc, best[:, None], axis=1)[:, 0])
    return np.stack(found[::2], axis=1), np.stack(found[1::2], axis=1)


def ndc_of(points: ArrayLike, clip_from_view: ArrayLike) -> Float64:
    """Return the ndc (..., 3) of points (..., 3) in view space."""
    matrix = np.asarray(clip_from_view, np.float64)
    clip = np.asarray(points, np.float64) @ matrix[:, :3].T + matrix[:, 3]
    return clip[..., :3] / clip[..., 3:]


def box_corners(centre: ArrayLike, *half_axes: ArrayLike) -> Float64:
    """Return the corners (..., 8, C) of boxes: centre (..., C) plus or minus each of three half axes (..., C)."""
    signs = np.array(np.meshgrid(*[(-1.0, 1.0)] * 3)).reshape(3, 8)
    axes = np.stack([np.asarray(axis, np.float64) for axis in half_axes], axis=-2)
    return np.asarray(centre, np.float64)[..., None, :] + np.einsum("as,...ac->...sc", signs, axes)


def distances_outside(points: ArrayLike, clip_from_view: ArrayLike) -> Float64:
    """Return how far sets of points (..., K, 3) are outside of the frustum as a whole: (...).

    It is the largest over the planes of the distance of the set's nearest point, negative where no plane separates.
    """
    planes = frustum_planes(clip_from_view)
    distance = np.asarray(points, np.float64) @ planes[:, :3].T + planes[:, 3]
    return -distance.max(axis=-2).min(axis=-1)


def largest_stretch(matrices: ArrayLike) -> Float64:
    """Return the largest |A v| / |v| of matrices (..., 3, 3): their largest singular values."""
    values: Float64 = np.linalg.svd(np.asarray(matrices, np.float64), compute_uv=False)[..., 0]
    return values


def screen_area(triangles: ArrayLike, clip_from_world: ArrayLike) -> Float64:
    """Return twice the signed area of triangles (..., 3, 3) on the screen, up to a positive factor; row 0 is on top.

    It is positive where the corners go round counter-clockwise for a viewer. The factor is the product of the three w,
    so triangles that reach behind the eye keep their sign (Olano and Greer 1997, "Triangle Scan Conversion using 2D
    Homogeneous Coordinates").
    """
    matrix = np.asarray(clip_from_world, np.float64)
    clip = np.asarray(triangles, np.float64) @ matrix[:, :3].T + matrix[:, 3]
    return -np.linalg.det(clip[..., [0, 1, 3]])


def coarsest_fit(first: ArrayLike, last: ArrayLike, levels: int = 20) -> NDArray[np.uint32]:
    """Return the lowest level, from 1 on, at which pixels first..last (..., 2) are in at most 2x2 texels."""
    first, last = np.asarray(first, np.int64)[..., None, :], np.asarray(last, np.int64)[..., None, :]
    edges = 2 ** np.arange(1, levels + 1)[:, None]
    fits = (last // edges - first // edges <= 1).all(axis=-1)
    return (fits.argmax(axis=-1) + 1).astype(np.uint32)


def pyramid_levels(depth: ArrayLike) -> list[NDArray[np.float32]]:
    """Return the levels of the pyramid of `depth` (H, W) or (H, W, samples): the minimum below each texel.

    Each level is made of the picture itself, not of the level before it. NaN counts as 0.
    """
    flat = np.asarray(depth, np.float32)
    flat = np.where(np.isnan(flat), np.float32(0.0), flat)
    flat = flat if flat.ndim == 2 else flat.min(axis=2)
    levels: list[NDArray[np.float32]] = []
    while not levels or levels[-1].size > 1:
        edge = 2 ** (len(levels) + 1)
        rows = np.minimum.reduceat(flat, range(0, flat.shape[0], edge), axis=0)
        levels.append(np.minimum.reduceat(rows, range(0, flat.shape[1], edge), axis=1))
    return levels
