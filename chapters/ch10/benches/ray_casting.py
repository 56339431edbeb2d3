"""Visibility by casting rays at the scene's triangles: the truth for shadow maps.

The rays are those of Mitsuba 3 (extra `reference`), which intersects triangles with Embree in single precision. Points
are computed in double precision on the plane of the triangle that a ray has met. Places are relative to the origin of
the scene, wherever in the world that is.
"""

from __future__ import annotations

from typing import Any, NamedTuple, cast

import numpy as np
from numpy.typing import NDArray

from common.scene import Pose, Scene
from common.scene.pose import evaluate_pose
from common.view.camera import View

Float64 = NDArray[np.float64]
Bool = NDArray[np.bool_]

LIFT = 3e-5
"""How far above a surface rays begin, in length scales: below it lies what they must not hit, the surface itself."""

FAR = 1e6
"""The length of rays to lights without a place, in length scales."""


class Surfaces(NamedTuple):
    """The surfaces that pixels show: numbers of the pixels, row by row, places, normals, and those of the triangles."""

    pixels: NDArray[np.intp]
    points: Float64
    normals: Float64
    flat: Float64


class _Soup(NamedTuple):
    """Triangles (T, 3, 3) with the normals of their corners, and the material of each."""

    corners: Float64
    normals: Float64
    materials: NDArray[np.intp]


def _triangles(scene: Scene, pose: Pose) -> _Soup:
    """Return the triangles of all visible instances, relative to the scene's origin."""
    found: list[tuple[Float64, Float64, NDArray[np.intp]]] = []
    for place in np.flatnonzero(scene.instances.visible).tolist():
        mesh = scene.meshes[scene.instances.mesh[place]]
        matrix, first = pose.world_from_object[place], int(mesh["first_index"])
        within = scene.indices[first : first + int(mesh["index_count"])].astype(np.int64)
        posed = pose.vertices.get(int(scene.instances.mesh[place]))
        if posed is None:
            within = within + int(mesh["first_vertex"])
        positions, normals = (scene.positions, scene.normals) if posed is None else posed[:2]
        placed = positions[within].astype(np.float64) @ matrix[:3, :3].T + matrix[:3, 3] - scene.origin
        turned = normals[within].astype(np.float64) @ _cofactors(matrix[:3, :3]).T
        count = len(within) // 3
        parts = placed.reshape(-1, 3, 3), turned.reshape(-1, 3, 3), np.full(count, int(mesh["material"]))
        found.append(parts)
    if not found:
        return _Soup(np.zeros((0, 3, 3)), np.zeros((0, 3, 3)), np.zeros(0, np.intp))
    return _Soup(*(np.concatenate(parts) for parts in zip(*found, strict=True)))


def _cofactors(matrix: Float64) -> Float64:
    """Return the matrix (3, 3) that turns normals, up to a positive length."""
    rows = [np.cross(matrix[:, 1], matrix[:, 2]), np.cross(matrix[:, 2], matrix[:, 0])]
    turned = np.stack([*rows, np.cross(matrix[:, 0], matrix[:, 1])], axis=1)
    return turned * np.sign(np.linalg.det(matrix) or 1.0)


class RayCaster:
    """The casters of a scene at time 0. Raises ImportError where the package is not installed."""

    def __init__(self, scene: Scene) -> None:
        import mitsuba as package

        self._mitsuba = cast(Any, package)  # its stubs name types of another variant
        self._mitsuba.set_variant("scalar_rgb")
        self._scene = scene
        soup = _triangles(scene, evaluate_pose(scene, 0.0))
        self._one_sided = np.array([not it.double_sided for it in scene.materials], bool)
        # What is unlit, or blended, casts no shadow; but it may hide what is behind it.
        modes = ["none" if it.unlit else it.alpha_mode for it in scene.materials]
        solid, masked = (
            np.array([it == mode for it in modes], bool)[soup.materials] for mode in ("opaque", "mask")
        )
        self._soup = _Soup(*(part[solid] for part in soup))
        self._everything = self._traced(np.concatenate([self._soup.corners, soup.corners[~solid]]))
        self._solid = self._traced(self._soup.corners)
        self._holes = self._traced(soup.corners[masked])
        self.lift = LIFT * scene.length_scale
        """Metres by which rays begin above a surface."""

    def _traced(self, corners: Float64) -> Any:
        """Return triangles as Mitsuba has them, None for none."""
        if not len(corners):
            return None
        mesh = self._mitsuba.Mesh("solid", vertex_count=3 * len(corners), face_count=len(corners))
        written = self._mitsuba.traverse(mesh)
        written["vertex_positions"] = corners.astype(np.float32).ravel()
        written["faces"] = np.arange(3 * len(corners), dtype=np.uint32)
        written.update()
        return self._mitsuba.load_dict({"type": "scene", "solid": mesh})

    # --- what pixels show ---

    def surfaces(self, view: View, size: tuple[int, int]) -> Surfaces:
        """Return what the rays through the middles of pixels meet, where it is opaque and seen from its front."""
        origins, along = self._eye_rays(view, size)
        hit = np.full(len(origins), -1, np.int64)
        if self._everything is not None:
            ray, point, vector = self._mitsuba.Ray3f, self._mitsuba.Point3f, self._mitsuba.Vector3f
            meets = self._everything.ray_intersect_preliminary
            for number, (begin, way) in enumerate(zip(origins.tolist(), along.tolist(), strict=True)):
                met = meets(ray(point(*begin), vector(*way)))
                if met.is_valid():
                    hit[number] = met.prim_index
        pixels = np.flatnonzero((hit >= 0) & (hit < len(self._soup.corners)))
        found = _on_triangles(origins[pixels], along[pixels], self._soup, hit[pixels])
        behind = (found.flat * along[pixels]).sum(axis=1) > 0.0
        shown = ~(behind & self._one_sided[self._soup.materials[hit[pixels]]])
        side = np.where(behind, -1.0, 1.0)[:, None]
        sides = found._replace(pixels=pixels, normals=found.normals * side, flat=found.flat * side)
        return Surfaces(*(part[shown] for part in sides))

    def _eye_rays(self, view: View, size: tuple[int, int]) -> tuple[Float64, Float64]:
        """Return origins and unit directions (H * W, 3) of the rays through the middles of pixels."""
        width, height = size
        y, x = np.divmod(np.arange(width * height), width)
        ndc = 2 * (np.stack([x, y], axis=1) + 0.5) / size - 1
        view_from_clip = np.linalg.inv(view.clip_from_view(width / height))
        pose = view.world_from_view.copy()
        pose[:3, 3] -= self._scene.origin
        ends = []
        for depth in (1.0, 0.5):  # a ray of any projection goes through two depths of its pixel
            clip = np.concatenate([ndc, np.full((len(ndc), 1), depth), np.ones((len(ndc), 1))], axis=1)
            seen = clip @ view_from_clip.T
            ends.append((seen / seen[:, 3:]) @ pose[:3].T)
        along = ends[1] - ends[0]
        return ends[0], along / np.linalg.norm(along, axis=1)[:, None]

    # --- what lies between ---

    def blocked(self, origins: Float64, targets: Float64) -> tuple[Bool, Bool]:
        """Return (R,) whether anything opaque lies between two places, and whether only something with holes does."""
        ways = targets - origins
        lengths = np.linalg.norm(ways, axis=1)
        ways = ways / np.where(lengths > 0.0, lengths, 1.0)[:, None]
        solid = self._meets(self._solid, origins, ways, lengths)
        perhaps = np.zeros(len(solid), bool)
        if self._holes is not None:
            perhaps[~solid] = self._meets(self._holes, origins[~solid], ways[~solid], lengths[~solid])
        return solid, perhaps

    def _meets(self, scene: Any, origins: Float64, ways: Float64, lengths: Float64) -> Bool:
        if scene is None:
            return np.zeros(len(origins), bool)
        ray, point, vector = self._mitsuba.Ray3f, self._mitsuba.Point3f, self._mitsuba.Vector3f
        test = scene.ray_test
        each = zip(origins.tolist(), ways.tolist(), lengths.tolist(), strict=True)
        hits = (test(ray(point(*begin), vector(*way), length, 0.0, [])) for begin, way, length in each)
        return np.fromiter(hits, bool, len(origins))


def _on_triangles(origins: Float64, along: Float64, soup: _Soup, hit: NDArray[np.int64]) -> Surfaces:
    """Return where rays meet the planes of triangles, in double precision."""
    corners = soup.corners[hit]
    first, edges = corners[:, 0], corners[:, 1:] - corners[:, :1]
    flat = np.cross(edges[:, 0], edges[:, 1])
    with np.errstate(divide="ignore", invalid="ignore"):
        distance = ((first - origins) * flat).sum(axis=1) / (along * flat).sum(axis=1)
        points = origins + distance[:, None] * along
        area2 = (flat * flat).sum(axis=1)
        within = points - first
        u = (np.cross(within, edges[:, 1]) * flat).sum(axis=1) / area2
        v = (np.cross(edges[:, 0], within) * flat).sum(axis=1) / area2
        weights = np.stack([1 - u - v, u, v], axis=1)
        normals = (soup.normals[hit] * weights[:, :, None]).sum(axis=1)
        normals /= np.linalg.norm(normals, axis=1)[:, None]
        flat /= np.sqrt(area2)[:, None]
    # Corners in either order: the side of a triangle is that of its normals.
    flat *= np.where((flat * normals).sum(axis=1) < 0.0, -1.0, 1.0)[:, None]
    return Surfaces(hit, points, normals, flat)
