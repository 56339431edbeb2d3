"""A grid of froxels in float64: slices of depth, places, the medium's light in each froxel, and what a pixel sees.

Volumes are (Z, Y, X, ...) as images of three dimensions are read; `uvw` are coordinates of such an image, v downwards.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tests.twins import fog

Float64 = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Grid:
    """Froxels of a view: `size` is (X, Y, Z); slice s ends at depth near * (far / near)^(s / Z) in metres.

    The first slice begins at the eye, so its middle lies in front of `near`.

    `clip_from_view` and `world_from_view` (4, 4) are those of the picture.
    """

    size: tuple[int, int, int]
    near: float
    far: float
    clip_from_view: Float64
    world_from_view: Float64

    def depth(self, w: ArrayLike) -> Float64:
        """Return the depth in metres at a third coordinate `w`, 0 at near and 1 at far."""
        return self.near * (self.far / self.near) ** np.asarray(w, np.float64)

    def w(self, depth: ArrayLike) -> Float64:
        """Return the third coordinate of a depth: the inverse of `depth`."""
        return np.log(np.asarray(depth, np.float64) / self.near) / np.log(self.far / self.near)

    def edges(self) -> Float64:
        """Return (Z + 1,) depths between slices, 0 in front of the first."""
        return np.concatenate([[0.0], self.depth(np.arange(1, self.size[2] + 1) / self.size[2])])

    def depths(self, part: ArrayLike = 0.5) -> Float64:
        """Return (Z,) depths at which slices take their samples: `part` of the way through, the first linearly."""
        index = np.arange(self.size[2])
        return np.where(
            index == 0, self.edges()[1] * part, self.depth((index + np.asarray(part)) / self.size[2])
        )

    def samples(self, part: ArrayLike = 0.5) -> Float64:
        """Return the points (Z, Y, X, 3) of the world at which froxels take their samples."""
        depth = np.broadcast_to(self.depths(part)[:, None, None], self.size[::-1])
        return self.world_from_uvw(self.centers(), depth)

    def view_from_uvw(self, uvw: ArrayLike, depth: ArrayLike | None = None) -> Float64:
        """Return points (..., 3) of view space, at `depth` (...) instead of the third coordinate if it is given."""
        uvw = np.asarray(uvw, np.float64)
        depth = self.depth(uvw[..., 2]) if depth is None else np.asarray(depth, np.float64)
        m = self.clip_from_view
        clip_w = m[3, 2] * -depth + m[3, 3]
        x, y = (
            ((2 * uvw[..., row] - 1) * clip_w - m[row, 2] * -depth - m[row, 3]) / m[row, row]
            for row in (0, 1)
        )
        return np.stack(np.broadcast_arrays(x, y, -depth), axis=-1)

    def world_from_uvw(self, uvw: ArrayLike, depth: ArrayLike | None = None) -> Float64:
        """Return points (..., 3) of the world."""
        return self.view_from_uvw(uvw, depth) @ self.world_from_view[:3, :3].T + self.world_from_view[:3, 3]

    def uvw_from_world(self, points: ArrayLike) -> Float64:
        """Return coordinates (..., 3) of points in front of the eye; the clip w of an orthographic view is no depth."""
        points = np.asarray(points, np.float64)
        view = (points - self.world_from_view[:3, 3]) @ self.world_from_view[:3, :3]
        clip = view @ self.clip_from_view[:, :3].T + self.clip_from_view[:, 3]
        with np.errstate(invalid="ignore"):
            return np.concatenate(
                [clip[..., :2] / clip[..., 3:] * 0.5 + 0.5, self.w(-view[..., 2:])], axis=-1
            )

    def centers(self, jitter: ArrayLike = (0.0, 0.0, 0.0)) -> Float64:
        """Return coordinates (Z, Y, X, 3) of the centres, moved by `jitter` (..., 3) froxels."""
        z, y, x = np.indices(self.size[::-1])
        return (np.stack([x, y, z], axis=-1) + 0.5 + np.asarray(jitter)) / self.size

    def stretch(self, uv: ArrayLike) -> Float64:
        """Return metres along the ray through `uv` (..., 2) per metre of depth: 1 over the cosine to the axis."""
        uv = np.asarray(uv, np.float64)
        ends = [self.view_from_uvw(uv, np.full(uv.shape[:-1], depth)) for depth in (1.0, 2.0)]
        return np.linalg.norm(ends[1] - ends[0], axis=-1)

    def rays(self, uv: ArrayLike) -> tuple[Float64, Float64]:
        """Return starts and unit directions (..., 3) in the world of the rays through `uv` (..., 2)."""
        uv = np.asarray(uv, np.float64)
        near, far = (self.world_from_uvw(uv, np.full(uv.shape[:-1], depth)) for depth in (0.0, 1.0))
        return near, (far - near) / np.linalg.norm(far - near, axis=-1, keepdims=True)


def injected(grid: Grid, medium: fog.Medium, part: float = 0.5) -> Float64:
    """Return scattering and extinction (Z, Y, X, 4) per metre, a `part` of the way through the slices."""
    return medium.at(grid.samples(part))


def scattered(
    grid: Grid,
    medium: fog.Medium,
    lights: Sequence[fog.Light],
    g: float,
    ambient: ArrayLike = (0.0, 0.0, 0.0),
    attenuated: bool = True,
) -> Float64:
    """Return light scattered to the eye per metre and extinction (Z, Y, X, 4): lamps, and `ambient` nits all around."""
    points = grid.samples()
    _, direction = grid.rays(grid.centers()[..., :2])
    data = medium.at(points)
    light = data[..., :3] * np.asarray(ambient)
    for lamp in lights:
        light = light + fog.scattered_at(points, -direction, medium, lamp, g, attenuated)
    return np.concatenate([light, data[..., 3:]], axis=-1)


def integrated(grid: Grid, volume: Float64) -> Float64:
    """Return light and transmittance (Z, Y, X, 4) from the eye to the far end of each froxel."""
    lengths = np.diff(grid.edges()) * grid.stretch(grid.centers()[0, ..., :2])[..., None]  # (Y, X, Z)
    columns = np.moveaxis(volume, 0, 2)
    light, seen = fog.integrate(columns[..., :3], columns[..., 3], lengths)
    return np.moveaxis(np.concatenate([light, seen[..., None]], axis=-1), 2, 0)


def sampled(volume: Float64, uvw: ArrayLike) -> Float64:
    """Return (..., C) a volume (Z, Y, X, C) between texel centres by three linear steps, clamped at its borders."""
    uvw = np.asarray(uvw, np.float64)
    size = np.array(volume.shape[2::-1])
    place = np.clip(uvw * size - 0.5, 0, size - 1)
    first = np.minimum(np.floor(place).astype(int), np.maximum(size - 2, 0))
    part = place - first
    found = np.zeros((*uvw.shape[:-1], volume.shape[-1]))
    for corner in np.ndindex(2, 2, 2):
        x, y, z = np.moveaxis(np.minimum(first + corner, size - 1), -1, 0)
        weight = np.where(corner, part, 1 - part).prod(axis=-1)
        found += weight[..., None] * volume[z, y, x]
    return found


def between_ends(grid: Grid, ends: Float64, uv: ArrayLike, depth: ArrayLike) -> Float64:
    """Return light and transmittance (..., 4) at a depth, linear between the ends of slices as a sampler has it.

    A texel holds the value at the far end of its slice: half a slice is taken off the third coordinate.
    """
    w = grid.w(np.maximum(depth, grid.near)) - 0.5 / grid.size[2]
    return sampled(ends, np.concatenate([np.asarray(uv), w[..., None]], axis=-1))


def within_slice(grid: Grid, ends: Float64, volume: Float64, uv: ArrayLike, depth: ArrayLike) -> Float64:
    """Return light and transmittance (..., 4) at a depth: the end of the slice before, and the closed form from there.

    Exact for a medium that is constant in each slice. Behind the last slice it is that slice's end.
    """
    uv, depth = np.asarray(uv, np.float64), np.minimum(np.asarray(depth, np.float64), grid.far)
    count = grid.size[2]
    number = np.clip(np.floor(grid.w(np.maximum(depth, grid.near)) * count).astype(int), 0, count - 1)

    def slice_of(values: Float64, k: NDArray[np.int64]) -> Float64:
        return sampled(values, np.concatenate([uv, ((k + 0.5) / count)[..., None]], axis=-1))

    before = slice_of(ends, np.maximum(number - 1, 0))
    before = np.where((number == 0)[..., None], (0.0, 0.0, 0.0, 1.0), before)
    here = slice_of(volume, number)
    way = (depth - grid.edges()[number]) * grid.stretch(uv)
    light = before[..., :3] + (before[..., 3] * way * fog.phi(here[..., 3] * way))[..., None] * here[..., :3]
    return np.concatenate([light, (before[..., 3] * np.exp(-here[..., 3] * way))[..., None]], axis=-1)


def reprojected(history: Float64, current: Float64, grid: Grid, before: Grid, share: float) -> Float64:
    """Return the current volume blended with the history at each centre's place in the grid of the frame before.

    A froxel whose place lies outside 0..1 in any axis, or behind the eye, keeps its current value.
    """
    uvw = before.uvw_from_world(grid.world_from_uvw(grid.centers()))
    inside = ((uvw >= 0) & (uvw <= 1)).all(axis=-1)  # a NaN of what lies behind the eye compares as false
    old = sampled(history, np.where(inside[..., None], uvw, 0.5))
    return np.where(inside[..., None], fog.blended(old, current, share), current)
