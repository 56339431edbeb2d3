"""What the bench of rays traces: triangles in instances, rays through them, and Embree's answers.

Every surface is opaque here, and meshes have their rest pose at time 0, so that all ways and Embree see one geometry.
Places are relative to the origin of the scene.
"""

from __future__ import annotations

import time as clock
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from common.numerics.transforms import translation
from common.scene import Scene
from common.scene.pose import evaluate_pose
from common.view.camera import Perspective, View, view_of_scene

from ..rays.triangles import build_order, mesh_triangles

Floats = NDArray[np.float32]
Integers = NDArray[np.int64]

FAR = 1e30
EDGE = 1e-3
"""A hit with a smaller barycentric coordinate is on an edge, where rounding may choose another triangle, or none."""

SAME_T = 1e-5
"""Two triangles that a ray meets at parameters that differ by less, relatively, lie in one place: either is right."""

NONE = -1


@dataclass(frozen=True)
class Geometry:
    """Meshes of (T, 3) indices and (V, 3) positions; of instances the mesh (I,) and the matrix (I, 3, 4)."""

    name: str
    meshes: list[tuple[NDArray[np.uint32], Floats]]
    mesh_of: Integers
    matrices: NDArray[np.float64]
    view: View

    @property
    def triangles(self) -> int:
        """The triangles of all meshes, each once."""
        return sum(len(indices) for indices, _ in self.meshes)

    def world(self) -> tuple[Floats, Integers]:
        """Return the (T, 3, 3) triangles of all instances, and their instance and number (T, 2)."""
        parts, ids = [np.zeros((0, 3, 3), np.float32)], [np.zeros((0, 2), np.int64)]
        for instance, (mesh, matrix) in enumerate(zip(self.mesh_of, self.matrices, strict=True)):
            indices, positions = self.meshes[mesh]
            corners = positions.astype(np.float64) @ matrix[:, :3].T + matrix[:, 3]
            parts.append(corners[indices].astype(np.float32))
            ids.append(np.stack([np.full(len(indices), instance), np.arange(len(indices))], axis=1))
        return np.concatenate(parts), np.concatenate(ids)

    def box(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the corners of the box around all triangles."""
        corners = self.world()[0].astype(np.float64)
        return corners.min(axis=(0, 1)), corners.max(axis=(0, 1))


def geometry_of(scene: Scene, name: str) -> Geometry:
    """Return the visible instances of a scene, and those of their triangles that a structure may have.

    `name` is that by which the scene is asked for: "atrium:small", where the scene itself is called "atrium".
    """
    shown = np.flatnonzero(scene.instances.visible)
    used, mesh_of = np.unique(scene.instances.mesh[shown], return_inverse=True)
    meshes = []
    for mesh in used.tolist():
        indices, positions = mesh_triangles(scene, mesh)
        meshes.append((indices[np.sort(build_order(indices, positions))], positions.astype(np.float32)))
    pose = evaluate_pose(scene, 0.0)
    matrices = np.array(pose.world_from_object, np.float64)[shown][:, :3]
    matrices[:, :, 3] -= scene.origin
    view = view_of_scene(scene, pose, None, 16 / 9)
    moved = translation(-np.asarray(scene.origin)) @ view.world_from_view
    return Geometry(name, meshes, mesh_of, matrices, View(moved, view.projection))


def sphere(segments: int, rings: int) -> Geometry:
    """Return a closed sphere of 2 segments (rings - 1) triangles, bent a little, and a view of it."""
    polar = np.arange(1, rings) / rings * np.pi
    around = np.arange(segments) / segments * 2 * np.pi
    y, flat = np.cos(polar)[:, None], np.sin(polar)[:, None]
    ring = np.stack(np.broadcast_arrays(flat * np.sin(around), y, flat * np.cos(around)), axis=-1)
    points = np.concatenate([ring.reshape(-1, 3), [(0, 1, 0), (0, -1, 0)]])
    points *= 1 + 0.05 * np.sin(9 * points[:, :1]) * np.sin(7 * points[:, 1:2])
    row, column = (it.reshape(-1) for it in np.indices((rings - 2, segments)))
    after = (column + 1) % segments
    a, b = row * segments + column, row * segments + after
    c, d = a + segments, b + segments
    top, below = len(points) - 2, len(points) - 1
    first, last = np.arange(segments), (rings - 2) * segments + np.arange(segments)
    turned = (np.arange(segments) + 1) % segments
    caps = [
        np.stack([np.full(segments, top), first, turned], axis=1),
        np.stack([np.full(segments, below), (rings - 2) * segments + turned, last], axis=1),
    ]
    sides = [np.stack([a, c, b], axis=1), np.stack([b, c, d], axis=1)]
    indices = np.concatenate([*sides, *caps]).astype(np.uint32)
    view = View(translation((0.0, 0.0, 2.6)), Perspective(yfov=0.9, near=0.1))
    return Geometry(
        "sphere", [(indices, points.astype(np.float32))], np.zeros(1, np.int64), np.eye(4)[None, :3], view
    )


# --- rays -------------------------------------------------------------------------------------------------------------


def camera_rays(geometry: Geometry, count: int) -> Floats:
    """Return (R, 8) rays through the middles of pixels, row by row, of a picture of about `count` pixels: 16 to 9."""
    height = max(int((count * 9 / 16) ** 0.5), 1)
    width = max(count // height, 1)
    y, x = np.divmod(np.arange(width * height), width)
    ndc = 2 * (np.stack([x, y], axis=1) + 0.5) / (width, height) - 1
    clip = np.concatenate([ndc, np.ones((len(ndc), 2))], axis=1)  # on the near plane
    seen = clip @ np.linalg.inv(geometry.view.clip_from_view(width / height)).T
    along = (seen[:, :3] / seen[:, 3:]) @ geometry.view.world_from_view[:3, :3].T
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    return rays_of(np.broadcast_to(geometry.view.world_from_view[:3, 3], along.shape), along)


def random_rays(geometry: Geometry, count: int, seed: int = 12) -> Floats:
    """Return (R, 8) rays between places chosen by lot in the box of a scene, a quarter larger; in no order."""
    low, high = geometry.box()
    low, high = low - (high - low) / 8, high + (high - low) / 8
    begins, ends = np.random.default_rng(seed).uniform(low, high, (2, count, 3))
    along = ends - begins
    return rays_of(begins, along / np.linalg.norm(along, axis=1, keepdims=True))


def rays_of(origins: Any, directions: Any) -> Floats:
    """Return rays as the shaders read them: origin, t_min, direction, t_max."""
    rays = np.zeros((len(origins), 8), np.float32)
    rays[:, :3], rays[:, 4:7], rays[:, 7] = origins, directions, FAR
    return rays


# --- hits -------------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Hits:
    """What rays hit: instance and triangle (R,), NONE for nothing, t (R,) and barycentric coordinates (R, 2)."""

    instance: Integers
    primitive: Integers
    t: Floats
    at: Floats

    @classmethod
    def of_words(cls, words: NDArray[np.uint32]) -> Hits:
        """Return the hits in the (R, 8) words that benches/trace.glsl writes."""
        signed = words.view(np.int32).astype(np.int64)
        missed = signed[:, 0] == NONE
        at = np.ascontiguousarray(words[:, 4:6]).view(np.float32)
        return cls(
            signed[:, 0],
            np.where(missed, NONE, signed[:, 1]),
            np.ascontiguousarray(words[:, 2]).view(np.float32),
            at,
        )

    @property
    def hit(self) -> NDArray[np.bool_]:
        """Which rays hit anything."""
        return self.instance != NONE

    @property
    def on_edge(self) -> NDArray[np.bool_]:
        """Which rays hit a triangle at its edge."""
        least = np.minimum(self.at.min(axis=1), 1 - self.at.sum(axis=1))
        return self.hit & (least < EDGE)


def agreement(found: Hits, truth: Hits, size: float = 1.0) -> dict[str, Any]:
    """Return how hits agree with others: `hits` and `edges` as shares of rays, off edges the share of `equal` ids.

    `ties` are rays that hit another triangle at the same t, `differ` the others with other ids; neither counts edges.
    Where ids are equal off edges, `t_error` is the largest relative difference of t, and `t_within` the share of those
    below SAME_T: rays that begin at a triangle or graze it have few digits of t in float32. `t_of_size` is the largest
    difference in parts of `size`, that of the scene; directions have the length 1.
    """
    off = ~(found.on_edge | truth.on_edge)
    equal = (found.instance == truth.instance) & (found.primitive == truth.primitive)
    both = found.hit & truth.hit
    apart = np.zeros(len(both))
    away = np.abs(found.t[both].astype(np.float64) - truth.t[both])
    apart[both] = away / truth.t[both]
    ties = off & ~equal & both & (apart <= SAME_T)
    sure = off & ~ties
    same = equal & both & off
    return {
        "hits": float(found.hit.mean()),
        "edges": float(1 - off.mean()),
        "equal": float(equal[sure].mean()) if sure.any() else 1.0,
        "ties": int(ties.sum()),
        "differ": int((sure & ~equal).sum()),
        "t_error": float(apart[same].max()) if same.any() else 0.0,
        "t_within": float((apart[same] <= SAME_T).mean()) if same.any() else 1.0,
        "t_of_size": float(away[same[both]].max()) / size if same.any() else 0.0,
    }


class Embree:
    """Embree's answers over the triangles of all instances, on one core. Raises ImportError without the package.

    `build_ms` is the time of its build. Embree does not tell how much memory it takes.
    """

    def __init__(self, geometry: Geometry) -> None:
        from embreex import rtcore_scene
        from embreex.mesh_construction import TriangleMesh

        corners, self._ids = geometry.world()
        began = clock.perf_counter()
        self._scene = rtcore_scene.EmbreeScene()
        # The mesh must stay: its memory is the scene's.
        indices = np.arange(3 * len(corners), dtype=np.int32).reshape(-1, 3)
        self._mesh = TriangleMesh(self._scene, corners.reshape(-1, 3), indices)
        self._run(rays_of([(0.0, 0.0, 0.0)], [(0.0, 0.0, 1.0)]))  # the first ray builds
        self.build_ms = 1e3 * (clock.perf_counter() - began)

    def _run(self, rays: Floats) -> Any:
        origins, ways = (np.ascontiguousarray(rays[:, at : at + 3]) for at in (0, 4))
        return self._scene.run(origins, ways, output=True)

    def trace(self, rays: Floats) -> tuple[Hits, float]:
        """Return what rays hit, and the seconds that it took."""
        began = clock.perf_counter()
        out = self._run(rays)
        took = clock.perf_counter() - began
        primitive = np.asarray(out["primID"], np.int64)
        ids = np.full((len(rays), 2), NONE)
        hit = primitive >= 0
        ids[hit] = self._ids[primitive[hit]]
        at = np.stack([out["u"], out["v"]], axis=1).astype(np.float32)
        return Hits(ids[:, 0], ids[:, 1], np.asarray(out["tfar"], np.float32), at), took
