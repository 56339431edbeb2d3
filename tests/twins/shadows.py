"""Float64 truth of shadows: rays against triangles, and the projection of a face."""

from __future__ import annotations

import numpy as np

NOTHING = 1e30


def triangles_of(scene, chosen=None) -> np.ndarray:
    """Return (T, 3, 3) corners in the world of all visible instances, or of those `chosen`."""
    from common.scene.pose import evaluate_pose

    pose, found = evaluate_pose(scene, 0.0), []
    for number in np.flatnonzero(scene.instances.visible) if chosen is None else chosen:
        mesh = scene.meshes[scene.instances.mesh[number]]
        first, count = int(mesh["first_index"]), int(mesh["index_count"])
        corners = scene.positions[
            int(mesh["first_vertex"]) + scene.indices[first : first + count].astype(np.int64)
        ]
        matrix = pose.world_from_object[number]
        found.append((corners.astype(np.float64) @ matrix[:3, :3].T + matrix[:3, 3]).reshape(-1, 3, 3))
    return np.concatenate(found)


def hits(origins: np.ndarray, directions: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Return (R, T) distances in lengths of the directions, inf where a ray misses (Moeller and Trumbore 1997)."""
    first, edge1, edge2 = (
        triangles[:, 0],
        triangles[:, 1] - triangles[:, 0],
        triangles[:, 2] - triangles[:, 0],
    )
    across = np.cross(directions[:, None], edge2[None])
    volume = (across * edge1).sum(-1)
    with np.errstate(divide="ignore", invalid="ignore"):
        inverse = 1.0 / volume
        away = origins[:, None] - first[None]
        u = (away * across).sum(-1) * inverse
        other = np.cross(away, edge1[None])
        v = (directions[:, None] * other).sum(-1) * inverse
        distance = (edge2 * other).sum(-1) * inverse
        inside = (u >= 0) & (v >= 0) & (u + v <= 1) & np.isfinite(distance)
    return np.where(inside, distance, np.inf)


def first_hit(origins, directions, triangles, least=0.0, rays=4096) -> np.ndarray:
    """Return (R,) the nearest distances beyond `least`, inf for none."""
    found = []
    for begin in range(0, len(origins), rays):
        part = slice(begin, begin + rays)
        distances = hits(origins[part], directions[part], triangles)
        found.append(np.where(distances > least, distances, np.inf).min(axis=1, initial=np.inf))
    return np.concatenate(found)


def face_rays(face) -> tuple[np.ndarray, np.ndarray]:
    """Return (size * size, 3) origins and directions through the centres of a face's texels, row by row.

    A direction advances by 1 along the axis of the face, so that distances are depths. Origins are relative to the
    scene's origin.
    """
    size = int(face["size"])
    at = np.arange(size) + 0.5 - size / 2
    axes = np.stack([face["right"], face["down"], face["ahead"]]).astype(np.float64)
    y, x = np.meshgrid(at / float(face["scale_y"]), at / float(face["scale_x"]), indexing="ij")
    plane = np.stack([x, y], -1).reshape(-1, 2) @ axes[:2]
    origin = face["origin"].astype(np.float64)
    if face["perspective"]:
        return np.broadcast_to(origin, plane.shape), plane + axes[2]
    return origin + plane, np.broadcast_to(axes[2], plane.shape)


def face_depths(face, triangles: np.ndarray) -> np.ndarray:
    """Return (size, size) depth of the first of some triangles, relative to the scene's origin, in each texel."""
    origins, directions = face_rays(face)
    nearest = first_hit(origins, directions, triangles, float(face["near"]))
    lengths = np.linalg.norm(directions, axis=1) if face["perspective"] else 1.0
    nearest[nearest * lengths > float(face["far"])] = NOTHING
    return nearest.reshape(int(face["size"]), -1)


def face_slopes(face, triangles: np.ndarray, depths: np.ndarray) -> np.ndarray:
    """Return (size, size) by how much `depths` of the first surfaces change in a texel along each axis, added up.

    A plane n . P = c around the origin of a face has Z = c / (n . r) at a ray r = (x / sx, y / sy, 1), and in an
    orthographic face Z = (c - n.x x / sx - n.y y / sy) / n.z. The plane at a texel is the one that has its depth.
    """
    axes = np.stack([face["right"], face["down"], face["ahead"]]).astype(np.float64)
    corners = (triangles - face["origin"].astype(np.float64)) @ axes.T
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    constants = (normals * corners[:, 0]).sum(axis=1)
    size, scale = int(face["size"]), np.array([face["scale_x"], face["scale_y"]], np.float64)
    at = np.arange(size) + 0.5 - size / 2
    y, x = np.meshgrid(at / scale[1], at / scale[0], indexing="ij")
    slopes, best = np.zeros((size, size)), np.full((size, size), np.inf)
    for n, c in zip(normals, constants, strict=True):
        with np.errstate(divide="ignore", invalid="ignore"):
            if face["perspective"]:
                along = n[0] * x + n[1] * y + n[2]
                depth, slope = c / along, np.abs(c) * (np.abs(n[:2]) / scale).sum() / along**2
            else:
                depth = (c - n[0] * x - n[1] * y) / n[2]
                slope = np.full_like(depth, (np.abs(n[:2]) / scale).sum() / np.abs(n[2]))
        off = np.abs(depth - depths)
        nearer = off < best
        best[nearer], slopes[nearer] = off[nearer], slope[nearer]
    return slopes
