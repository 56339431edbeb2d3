"""How likely each texel of an environment's cube map is to be drawn: in proportion to the light that it sends."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from common.environment.directions import cube_direction, cube_solid_angles, cube_uv
from common.images.color import LUMINANCE

Float64 = NDArray[np.float64]


def cube_weights(radiance: ArrayLike, size: int | None = None) -> Float64:
    """Return the weights (6, size, size) of a cube's texels: luminance, filtered, times solid angle.

    `radiance` is (6, n, n, 3 or more), `size` a whole part of n (default: n). The map is looked up with a linear
    filter, which takes light from neighbours, across the edges of the cube, too. So the mean of the filtered texel
    counts: a texel's weight is above 0 if there is light anywhere in it.

    Raises:
        ValueError: another shape, a size that is no whole part, or radiance that is negative or not finite.
    """
    texels = np.asarray(radiance)
    if texels.ndim != 4 or texels.shape[0] != 6 or texels.shape[1] != texels.shape[2] or texels.shape[3] < 3:
        raise ValueError(f"a cube map is (6, n, n, 3 or more), not {texels.shape}")
    edge = texels.shape[1]
    size = edge if size is None else size
    if not 1 <= size <= edge or edge % size:
        raise ValueError(f"{edge} texels along an edge are no whole multiple of {size}")
    light = texels[..., :3].astype(np.float64)
    if not (np.isfinite(light).all() and light.min() >= 0):
        raise ValueError("radiance is finite and not negative")
    luminance = light @ np.asarray(LUMINANCE, np.float64)
    weights = _filtered(luminance) * cube_solid_angles(edge)
    part = edge // size
    return np.asarray(weights.reshape(6, size, part, size, part).sum(axis=(2, 4)))


def _filtered(texels: Float64) -> Float64:
    """Return the mean of linearly filtered texels (6, n, n) over each texel's area: 1/8, 3/4, 1/8 along both axes."""
    edge = texels.shape[1]
    rim = np.pad(texels, ((0, 0), (1, 1), (1, 1)))
    # What lies a texel outside a face is on its neighbour. At the corners no fourth texel exists: drivers use a mean
    # of the three others, and so does this.
    at = (np.arange(edge) + 0.5) / edge
    outside = 0.5 / edge
    for face in range(6):
        for row, column, u, v in (
            (0, slice(1, -1), at, np.full(edge, -outside)),
            (-1, slice(1, -1), at, np.full(edge, 1 + outside)),
            (slice(1, -1), 0, np.full(edge, -outside), at),
            (slice(1, -1), -1, np.full(edge, 1 + outside), at),
        ):
            other, uv = cube_uv(cube_direction(face, np.stack([u, v], axis=-1)))
            place = np.clip((uv * edge).astype(np.intp), 0, edge - 1)
            rim[face, row, column] = texels[other, place[:, 1], place[:, 0]]
    for row, column in ((0, 0), (0, -1), (-1, 0), (-1, -1)):
        near_row, near_column = (1 if row == 0 else -2), (1 if column == 0 else -2)
        rim[:, row, column] = (
            rim[:, row, near_column] + rim[:, near_row, column] + rim[:, near_row, near_column]
        ) / 3
    across = rim[:, :, 1:-1] * 0.75 + (rim[:, :, :-2] + rim[:, :, 2:]) * 0.125
    return np.asarray(across[:, 1:-1] * 0.75 + (across[:, :-2] + across[:, 2:]) * 0.125)
