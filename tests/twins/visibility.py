"""The visibility buffer in double precision: a rasteriser, barycentrics by an inverse, and levels of textures."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from common.scene import Scene
from common.scene.pose import evaluate_pose
from common.view.camera import View

Float64 = NDArray[np.float64]

CLOSE = 1e-5
"""Relative difference of depths up to which 32 bits may order two surfaces either way."""


def barycentrics(clip: Float64, ndc: Float64) -> Float64:
    """Return (N, 3) perspective-correct weights at `ndc` (N, 2) of triangles with clip positions (N, 3, 4).

    The weights are e / sum(e) with e = (x, y, 1) M^-1, where the rows of M are (x, y, w) of the vertices.
    """
    inverse = np.linalg.inv(clip[:, :, [0, 1, 3]])
    e = np.einsum("ni,nij->nj", np.concatenate([ndc, np.ones((len(ndc), 1))], axis=1), inverse)
    weights: Float64 = e / e.sum(axis=1, keepdims=True)
    return weights


def differences(clip: Float64, ndc: Float64, size: tuple[int, int], step: float = 1e-3) -> list[Float64]:
    """Return the changes (N, 3) of the weights from a pixel to the next along x and along y: central differences."""
    found = []
    for axis in (0, 1):
        shift = np.zeros(2)
        shift[axis] = step * 2.0 / size[axis]
        found.append((barycentrics(clip, ndc + shift) - barycentrics(clip, ndc - shift)) / (2.0 * step))
    return found


def level(dx: Float64, dy: Float64, texels: tuple[int, int]) -> Float64:
    """Return the level of a texture whose uv change by `dx` and `dy` (..., 2) from pixel to pixel: Vulkan 1.3, 16.5.7.

    The longer one of both changes counts, in texels: the level of an isotropic filter.
    """
    longer = np.maximum(*(np.linalg.norm(change * np.array(texels), axis=-1) for change in (dx, dy)))
    levels: Float64 = np.log2(np.maximum(longer, 1e-12))
    return levels


@dataclass(frozen=True)
class Raster:
    """By pixel (H, W): instance (-1: none), triangle of its mesh, depth, and whether all of that is beyond doubt."""

    instance: NDArray[np.int64]
    triangle: NDArray[np.int64]
    depth: Float64
    sure: NDArray[np.bool_]
    clip: Float64
    """(H, W, 3, 4) the clip positions of the vertices of the triangle."""


def triangles_of(scene: Scene, view: View, size: tuple[int, int]) -> tuple[NDArray[np.int64], Float64]:
    """Return (T, 2) instance and triangle of everything solid, and clip positions (T, 3, 4)."""
    world = evaluate_pose(scene, 0.0).world_from_object
    clip_from_world = view.clip_from_world(size[0] / size[1])
    ids, corners = [], []
    for instance, mesh in enumerate(scene.instances.mesh.tolist()):
        row = scene.meshes[mesh]
        if scene.materials[row["material"]].alpha_mode == "blend":
            continue
        first, count = int(row["first_index"]), int(row["index_count"]) // 3
        indices = scene.indices[first : first + 3 * count].reshape(-1, 3).astype(int) + int(
            row["first_vertex"]
        )
        places = np.concatenate([scene.positions[indices].astype(float), np.ones((count, 3, 1))], axis=2)
        clip = places @ (clip_from_world @ world[instance]).T
        if not scene.materials[row["material"]].double_sided:
            # Rows of the picture grow downwards: what winds counter-clockwise to the eye has a negative area.
            mirrored = np.linalg.det(world[instance][:3, :3]) < 0
            kept = (np.linalg.det(clip[:, :, [0, 1, 3]]) < 0) != mirrored
            clip, numbers = clip[kept], np.flatnonzero(kept)
        else:
            numbers = np.arange(count)
        ids.append(np.stack([np.full(len(numbers), instance), numbers], axis=1))
        corners.append(clip)
    return np.concatenate(ids), np.concatenate(corners)


def raster(scene: Scene, view: View, size: tuple[int, int], margin: float = 1 / 16) -> Raster:
    """Return what is nearest at the centre of each pixel, by brute force over triangles with homogeneous edges.

    A pixel is in doubt if its centre is within `margin` pixels of an edge of a triangle that is not behind what is
    seen, or if two triangles are equally near.
    """
    ids, clip = triangles_of(scene, view, size)
    width, height = size
    y, x = np.mgrid[0:height, 0:width]
    centres = np.stack([(x + 0.5) * 2 / width - 1, (y + 0.5) * 2 / height - 1, np.ones(x.shape)])
    best, second, edge = (np.zeros(x.shape) for _ in range(3))
    winner = np.full(x.shape, -1)
    for number, corners in enumerate(clip):
        m = corners[:, [0, 1, 3]]
        rows = np.stack([np.cross(m[1], m[2]), np.cross(m[2], m[0]), np.cross(m[0], m[1])])
        lengths = np.hypot(rows[:, 0] * 2 / width, rows[:, 1] * 2 / height)
        determinant = m[0] @ rows[0]
        if abs(determinant) < 1e-30 or not (lengths > 0).all():
            continue
        box = _box(m, size)
        e = np.tensordot(rows * np.sign(determinant), centres[:, *box], 1)
        distance = (e / lengths[:, None, None]).min(axis=0)
        with np.errstate(divide="ignore", invalid="ignore"):
            depth = np.tensordot(corners[:, 2], e, 1) / np.tensordot(corners[:, 3], e, 1)
        seen = (e.sum(axis=0) > 0) & (depth > 0) & (depth <= 1)
        near_edge = seen & (np.abs(distance) <= margin)
        edge[box] = np.where(near_edge, np.maximum(edge[box], depth), edge[box])
        inside = seen & (distance >= 0)
        closer = inside & (depth > best[box])
        second[box] = np.where(
            closer, best[box], np.where(inside, np.maximum(second[box], depth), second[box])
        )
        best[box], winner[box] = np.where(closer, depth, best[box]), np.where(closer, number, winner[box])
    sure = (edge < best * (1 - CLOSE)) & (second < best * (1 - CLOSE)) | ((best == 0) & (edge == 0))
    found = np.where(winner[..., None] >= 0, ids[winner], -1)
    return Raster(found[..., 0], found[..., 1], best, sure, clip[winner])


def _box(m: Float64, size: tuple[int, int]) -> tuple[slice, slice]:
    """Return rows and columns of pixels that a triangle with rows (x, y, w) may touch: all if a vertex is behind."""
    if not (m[:, 2] > 0).all():
        return slice(0, size[1]), slice(0, size[0])
    place = (m[:, :2] / m[:, 2:] + 1) / 2 * size
    low = np.clip(np.floor(place.min(axis=0)) - 1, 0, size).astype(int)
    high = np.clip(np.ceil(place.max(axis=0)) + 1, 0, size).astype(int)
    return slice(low[1], high[1]), slice(low[0], high[0])
