"""Reflections in screen space in double precision: rays on the screen, their march, and the box of blur."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from common.view.camera import Orthographic, View

Float64 = NDArray[np.float64]


class Rays(NamedTuple):
    """Mirrored rays (N,) on the screen: `first`, `last` (N, 3) are column, row, depth; `direction` (N, 3) world."""

    first: Float64
    last: Float64
    direction: Float64

    @property
    def length(self) -> Float64:
        """Of each ray on the screen, in pixels (N,)."""
        length: Float64 = np.linalg.norm(self.last[:, :2] - self.first[:, :2], axis=1)
        return length


def world_at(pixels: Float64, depth: Float64, view: View, size: tuple[int, int]) -> Float64:
    """Return the points (N, 3) of the world that pixels (N, 2) show at `depth` (N,); places count from corners."""
    ndc = np.asarray(pixels) / size * 2.0 - 1.0
    clip = np.column_stack([ndc, depth, np.ones(len(ndc))])
    inverse = np.linalg.inv(view.clip_from_view(size[0] / size[1]) @ view.view_from_world())
    points = clip @ inverse.T
    found: Float64 = points[:, :3] / points[:, 3:]
    return found


def seen_at(points: Float64, view: View, size: tuple[int, int]) -> Float64:
    """Return column, row and depth (N, 3) of world points in front of the eye."""
    matrix = view.clip_from_view(size[0] / size[1]) @ view.view_from_world()
    clip = np.column_stack([points, np.ones(len(points))]) @ matrix.T
    ndc = clip[:, :3] / clip[:, 3:]
    return np.column_stack([(ndc[:, :2] * 0.5 + 0.5) * size, ndc[:, 2]])


def mirrored(places: Float64, depth: Float64, normals: Float64, view: View, size: tuple[int, int]) -> Rays:
    """Return the rays that surfaces with unit `normals` (N, 3) reflect at pixels (N, 2), cut where the picture ends."""
    pose = np.asarray(view.world_from_view)
    points = world_at(places, depth, view, size)
    seen = points - pose[:3, 3]
    if isinstance(view.projection, Orthographic):
        seen = np.tile(-pose[:3, 2], (len(points), 1))
    seen = seen / np.linalg.norm(seen, axis=1, keepdims=True)
    direction = seen - 2.0 * np.sum(seen * normals, axis=1, keepdims=True) * normals
    matrix = view.clip_from_view(size[0] / size[1]) @ view.view_from_world()
    start = np.column_stack([points, np.ones(len(points))]) @ matrix.T
    along = direction @ matrix[:, :3].T
    x, y, z, w = start.T
    dx, dy, dz, dw = along.T
    inside = np.stack([w - x, w + x, w - y, w + y, w - z, z])
    change = np.stack([dw - dx, dw + dx, dw - dy, dw + dy, dw - dz, dz])
    with np.errstate(divide="ignore", invalid="ignore"):
        t = np.where(change < 0.0, inside / -change, np.inf).min(axis=0)
        end = np.where(np.isfinite(t)[:, None], start + np.nan_to_num(t)[:, None] * along, along)
        ndc = end[:, :3] / end[:, 3:]
    last = np.column_stack([(ndc[:, :2] * 0.5 + 0.5) * size, ndc[:, 2]])
    return Rays(np.column_stack([places, depth]), last, direction)


def distances(depth: Float64, view: View) -> Float64:
    """Return the distance from the plane of the eye; at infinity it is 1e30."""
    projection = view.projection
    if isinstance(projection, Orthographic):
        return projection.far + depth * (projection.near - projection.far)
    return np.where(depth > 0.0, projection.near / np.where(depth > 0.0, depth, 1.0), 1e30)


def depth_at(depth: Float64, places: Float64, view: View, thickness: float) -> Float64:
    """Return depth (N,) of a picture (H, W) at places (N, 2): linear within a surface, else the nearest pixel's."""
    height, width = depth.shape
    corner = np.floor(places - 0.5)
    f = places - 0.5 - corner
    columns = [np.clip(corner[:, 0] + i, 0, width - 1).astype(int) for i in (0, 1)]
    rows = [np.clip(corner[:, 1] + i, 0, height - 1).astype(int) for i in (0, 1)]
    d = np.stack([depth[rows[j], columns[i]] for j in (0, 1) for i in (0, 1)])
    least, most = d.min(axis=0), d.max(axis=0)
    apart = (least == 0.0) | (distances(least, view) > distances(most, view) * (1.0 + thickness))
    nearest = np.take_along_axis(d, ((f[:, 1] >= 0.5) * 2 + (f[:, 0] >= 0.5))[None].astype(int), axis=0)[0]
    upper, lower = d[0] + (d[1] - d[0]) * f[:, 0], d[2] + (d[3] - d[2]) * f[:, 0]
    return np.where(apart, nearest, upper + (lower - upper) * f[:, 1])


def march(
    rays: Rays,
    depth: Float64,
    normals: Float64,
    has_normal: NDArray[np.bool_],
    view: View,
    *,
    steps: int,
    refinements: int,
    thickness: float,
) -> Float64:
    """Return the places (N, 2) at which rays end in a picture of `depth` (H, W) and `normals` (H, W, 3), else NaN."""
    height, width = depth.shape
    places = np.full((len(rays.first), 2), np.nan)

    def ends_inside(low: Float64, high: Float64) -> NDArray[np.bool_]:
        shown = depth_at(depth, high[:, :2], view, thickness)
        nearest = np.minimum(distances(low[:, 2], view), distances(high[:, 2], view))
        within = nearest <= distances(shown, view) * (1.0 + thickness)
        inside: NDArray[np.bool_] = (shown > 0.0) & (high[:, 2] < shown) & within
        return inside

    active = np.flatnonzero(rays.length >= 1.0)
    before = rays.first[active]
    for step in range(1, steps + 1):
        first, last = rays.first[active], rays.last[active]
        here = first + (last - first) * (step / steps)
        candidate = np.flatnonzero(ends_inside(before, here))
        low, high = before[candidate], here[candidate]
        for _ in range(refinements):
            middle = 0.5 * (low + high)
            behind = (middle[:, 2] < depth_at(depth, middle[:, :2], view, thickness))[:, None]
            low, high = np.where(behind, low, middle), np.where(behind, middle, high)
        columns = np.clip(high[:, 0].astype(int), 0, width - 1)
        rows = np.clip(high[:, 1].astype(int), 0, height - 1)
        facing = np.sum(normals[rows, columns] * rays.direction[active[candidate]], axis=1) < 0.0
        met = ends_inside(low, high) & (facing | ~has_normal[rows, columns])
        places[active[candidate[met]]] = high[met, :2]
        stays = np.ones(len(active), bool)
        stays[candidate[met]] = False
        active, before = active[stays], here[stays]
    return places


def boxed(hits: Float64, color: Float64, sizes: NDArray[np.int64]) -> Float64:
    """Return the mean light (H, W, 4) over the box of each pixel: rgb times weight, and the weight.

    `hits` (H, W, 4): column, row, weight, and 1 where the surface reflects. `sizes` (H, W) are edges of boxes.
    """
    height, width = sizes.shape
    mean = np.zeros((height, width, 4))
    for row, column in np.argwhere(hits[..., 3] > 0):
        radius = sizes[row, column] // 2
        box = hits[
            max(row - radius, 0) : row + radius + 1, max(column - radius, 0) : column + radius + 1
        ].reshape(-1, 4)
        met = box[box[:, 2] > 0]
        light = color[met[:, 1].astype(int), met[:, 0].astype(int), :3]
        weighted = np.column_stack([light, np.ones(len(met))]) * met[:, 2:3]
        mean[row, column] = weighted.sum(axis=0) / box[:, 3].sum()
    return mean
