"""What a camera sees, in float64 and without a renderer: the nearest opaque triangle at each pixel's centre."""

from __future__ import annotations

import numpy as np

from common.scene import Scene
from common.scene.pose import Pose
from common.view.camera import view_of_scene


def opaque_triangles(scene: Scene, pose: Pose) -> tuple[np.ndarray, np.ndarray]:
    """Return the triangles (T, 3, 3) of all instances in the world but for blended ones, and the instance of each."""
    triangles, owners = [], []
    for k, mesh in enumerate(scene.instances.mesh):
        record = scene.meshes[mesh]
        if scene.materials[int(record["material"])].alpha_mode == "blend":
            continue
        first, count = int(record["first_index"]), int(record["index_count"])
        corners = scene.indices[first : first + count].reshape(-1, 3) + int(record["first_vertex"])
        world = pose.world_from_object[k].astype(np.float64)
        triangles.append(scene.positions[corners].astype(np.float64) @ world[:3, :3].T + world[:3, 3])
        owners.append(np.full(count // 3, k))
    return np.concatenate(triangles), np.concatenate(owners)


def seen(
    scene: Scene, pose: Pose, triangles: np.ndarray, owners: np.ndarray, name: str, size: tuple[int, int]
) -> tuple[np.ndarray, np.ndarray]:
    """Return the points (N, 3) that the pixels' centres of a camera show, and their instances (N,).

    The ray through a pixel meets a triangle where its direction is a sum of the corners, seen from the eye, with no
    negative factor: no clipping is needed. Only pixels in the bounds of a triangle on the screen are tried.
    """
    width, height = size
    view = view_of_scene(scene, pose, name, width / height)
    world_from_view = np.array(view.world_from_view, np.float64)
    eye, axes = world_from_view[:3, 3], world_from_view[:3, :3]
    clip = np.array(view.clip_from_world(width / height), np.float64)
    clip_from_view = clip @ world_from_view
    scale = np.array([clip_from_view[0, 0], clip_from_view[1, 1]])
    local = (triangles - eye) @ axes  # view space: -z is ahead
    ahead = -local[..., 2]
    keep = (ahead > 0.05).any(axis=1)
    for axis in (0, 1):  # all corners beyond one edge of the picture
        for sign in (-1.0, 1.0):
            keep &= (sign * local[..., axis] * scale[axis] <= ahead).any(axis=1)
    local, ahead, owner = local[keep], ahead[keep], owners[keep]
    whole = (ahead > 0.05).all(axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        ndc = local[..., :2] * scale / ahead[..., None]
    pixel = (ndc * [0.5, -0.5] + 0.5) * [width, height] - 0.5
    low = np.where(whole[:, None], np.ceil(pixel.min(axis=1)), 0.0).clip(0, [width, height]).astype(np.int64)
    high = (
        np.where(whole[:, None], np.floor(pixel.max(axis=1)), 1e9)
        .clip(-1, [width - 1, height - 1])
        .astype(np.int64)
    )
    span = (high - low + 1).clip(0)
    count = span.prod(axis=1)
    which = np.repeat(np.arange(len(local)), count)
    within = np.arange(count.sum()) - np.repeat(np.cumsum(count) - count, count)
    column = low[which, 0] + within % span[which, 0]
    row = low[which, 1] + within // span[which, 0]
    ray = np.stack(
        [((column + 0.5) / width * 2 - 1) / scale[0], (1 - (row + 0.5) / height * 2) / scale[1]], -1
    )
    ray = np.concatenate([ray, np.full((len(ray), 1), -1.0)], axis=1)
    a, b, c = local[which].transpose(1, 0, 2)
    factors = np.stack([(np.cross(p, q) * ray).sum(-1) for p, q in ((b, c), (c, a), (a, b))], -1)
    volume = (np.cross(a, b) * c).sum(-1)
    factors *= np.sign(volume)[:, None]
    total = factors.sum(-1)
    hit = (factors >= 0).all(axis=1) & (total > 0)
    distance = np.abs(volume[hit]) / total[hit]
    cell = row[hit] * width + column[hit]
    order = np.lexsort((distance, cell))
    _, first = np.unique(cell[order], return_index=True)
    best = order[first]
    points = (ray[hit][best] * distance[best, None]) @ axes.T + eye
    return points, owner[which[hit][best]]
