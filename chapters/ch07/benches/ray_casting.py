"""Ambient occlusion by casting rays at the scene's triangles: the truth for what is found in screen space.

The rays are those of Mitsuba 3 (extra `reference`), which intersects triangles with Embree. The truth shares nothing
with a renderer: a ray through the middle of a pixel finds the surface, and a hemisphere of rays around the triangle's
own normal finds what occludes it.
"""

from __future__ import annotations

from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from common.scene import Scene
from common.scene.pose import evaluate_pose
from common.view.camera import View

Float64 = NDArray[np.float64]

LIFT = 1e-3
"""How far above a surface its rays begin, in radii: below it lies what they must not hit, the surface itself."""


def world_triangles(scene: Scene) -> tuple[Float64, NDArray[np.int64]]:
    """Return the corners (T, 3, 3) in the world of all visible triangles that are not blended, and their materials (T).

    They are those of time 0.
    """
    pose = evaluate_pose(scene, 0.0)
    parts, materials = [np.zeros((0, 3, 3))], [np.zeros(0, np.int64)]
    for place in np.flatnonzero(scene.instances.visible):
        number = int(scene.instances.mesh[place])
        mesh = scene.meshes[number]
        material = int(mesh["material"])
        if scene.materials[material].alpha_mode == "blend":
            continue
        first, count = int(mesh["first_index"]), int(mesh["index_count"])
        indices = scene.indices[first : first + count].astype(np.int64)
        if number in pose.vertices:
            corners = pose.vertices[number][0][indices]
        else:
            corners = scene.positions[indices + int(mesh["first_vertex"])]
        matrix = pose.world_from_object[place]
        parts.append((corners.astype(np.float64) @ matrix[:3, :3].T + matrix[:3, 3]).reshape(-1, 3, 3))
        materials.append(np.full(len(parts[-1]), material))
    return np.concatenate(parts), np.concatenate(materials)


def cosine_directions(count: int, rng: np.random.Generator) -> Float64:
    """Return (count, 3) directions around +z with a density of cos / pi, in strata of equal size."""
    rows = max(1, int(np.sqrt(count)))
    columns = -(-count // rows)
    y, x = np.divmod(np.arange(rows * columns), columns)
    part, turn = rng.random((2, len(x)))
    squared, angle = (y + part) / rows, 2 * np.pi * (x + turn) / columns
    across = np.sqrt(squared)
    return np.stack([across * np.cos(angle), across * np.sin(angle), np.sqrt(1 - squared)], axis=1)[:count]


def frame_around(normal: Float64) -> Float64:
    """Return a rotation (3, 3) whose last column is a unit vector."""
    side = np.eye(3)[np.argmin(np.abs(normal))]
    tangent = np.cross(normal, side)
    tangent /= np.linalg.norm(tangent)
    return np.stack([tangent, np.cross(normal, tangent), normal], axis=1)


class RayCaster:
    """The triangles of a scene, to be hit by rays. They are as solid as a mask without holes."""

    def __init__(self, scene: Scene) -> None:
        import mitsuba as package

        mitsuba = self._mitsuba = cast(Any, package)  # its stubs name types of another variant
        mitsuba.set_variant("scalar_rgb")
        corners, materials = world_triangles(scene)
        compared = [it.alpha_mode == "opaque" and not it.unlit for it in scene.materials]
        self._compared = np.array(compared, bool)[materials]
        # Single precision holds them around the scene's own origin, wherever in the world that is.
        self._origin = np.asarray(scene.origin, np.float64)
        placed = (corners - self._origin).reshape(-1, 3)
        mesh = mitsuba.Mesh("solid", vertex_count=len(placed), face_count=len(corners))
        written = mitsuba.traverse(mesh)
        written["vertex_positions"] = placed.astype(np.float32).ravel()
        written["faces"] = np.arange(len(placed), dtype=np.uint32)
        written.update()
        self._scene: Any = mitsuba.load_dict({"type": "scene", "solid": mesh})

    def visibility(
        self, view: View, size: tuple[int, int], radius: float, rays: int, every: int = 1
    ) -> Float64:
        """Return (H, W) the part of cosine-weighted rays that meet nothing within `radius` metres.

        Only each `every`-th pixel of each row and column is computed. The others are NaN, and so are those that show
        no surface, or one that is unlit or may have holes: a ray sees no mask.
        """
        width, height = size
        view_from_clip = np.linalg.inv(view.clip_from_view(width / height))
        pose = view.world_from_view.copy()
        pose[:3, 3] -= self._origin
        rng = np.random.default_rng(7)
        found = np.full((height, width), np.nan)
        for y in range(every // 2, height, every):
            for x in range(every // 2, width, every):
                ndc = 2 * (np.array([x, y]) + 0.5) / (width, height) - 1
                # Two depths of the pixel: a ray of any projection goes through both.
                near, far = (view_from_clip @ (*ndc, depth, 1.0) for depth in (1.0, 0.5))
                begin, end = pose @ (near / near[3]), pose @ (far / far[3])
                found[y, x] = self._pixel(begin[:3], (end - begin)[:3], radius, cosine_directions(rays, rng))
        return found

    def _pixel(self, begin: Float64, along: Float64, radius: float, directions: Float64) -> float:
        """Return the visible part of the surface that a ray meets, NaN if it meets none to be compared."""
        ray, point, vector = self._mitsuba.Ray3f, self._mitsuba.Point3f, self._mitsuba.Vector3f
        along = along / np.linalg.norm(along)
        hit = self._scene.ray_intersect(ray(point(*begin.tolist()), vector(*along.tolist())))
        if not hit.is_valid() or not self._compared[hit.prim_index]:
            return float("nan")
        normal = np.array(hit.n, np.float64)
        normal *= -np.sign(normal @ along) or 1.0
        origin = point(*(np.array(hit.p, np.float64) + LIFT * radius * normal).tolist())
        test = self._scene.ray_test
        free = 0
        for direction in (directions @ frame_around(normal).T).tolist():
            free += not test(ray(origin, vector(*direction), radius, 0.0, []))
        return free / len(directions)
