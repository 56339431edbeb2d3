"""Triangle meshes from a few generators: everything here is a grid of points, bent, and joined with others.

A grid has rows and columns; u grows along a row, v down the rows, as in a picture, and the surface is seen from the
side where u points right and v down. `surface` alone decides winding, tangents and which triangles exist.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

Float64 = NDArray[np.float64]
Int64 = NDArray[np.int64]
Vector = Sequence[float] | NDArray[np.float64]


@dataclass(frozen=True)
class Mesh:
    """Vertices and triangles, counter-clockwise seen from outside.

    `positions`, `normals` (V, 3); `triangles` (T, 3); `uv0`, `uv1` (V, 2); `tangents` (V, 4) with w = +-1 such that
    cross(normal, tangent) * w points up in the texture; `colors` (V, 4) linear in 0..1. Optional ones may be None.
    """

    positions: Float64
    normals: Float64
    triangles: Int64
    uv0: Float64 | None = None
    tangents: Float64 | None = None
    uv1: Float64 | None = None
    colors: Float64 | None = None

    def check(self) -> None:
        """Raise AssertionError where arrays do not belong together; a generator's own mistake, never a user's."""
        count = len(self.positions)
        for array in (self.normals, self.uv0, self.tangents, self.uv1, self.colors):
            assert array is None or (len(array) == count and np.isfinite(array).all())
        assert (
            np.isfinite(self.positions).all() and self.triangles.min() >= 0 and self.triangles.max() < count
        )
        assert np.allclose(np.linalg.norm(self.normals, axis=1), 1.0), "a normal has no direction"

    def moved(self, offset: Vector) -> Mesh:
        """Return the mesh shifted by `offset` metres."""
        return replace(self, positions=self.positions + np.asarray(offset, np.float64))

    def turned(self, matrix: Float64) -> Mesh:
        """Return the mesh under a (3, 3) rotation (determinant +1)."""
        tangents = self.tangents
        if tangents is not None:
            tangents = np.concatenate([tangents[:, :3] @ matrix.T, tangents[:, 3:]], axis=1)
        return replace(
            self, positions=self.positions @ matrix.T, normals=self.normals @ matrix.T, tangents=tangents
        )

    def without_tangents(self) -> Mesh:
        """Return the mesh without tangents, for a loader to make them."""
        return replace(self, tangents=None)

    def painted(self, color: Vector) -> Mesh:
        """Return the mesh with one vertex colour, linear rgb."""
        return replace(self, colors=np.tile(np.array([*color, 1.0][:4]), (len(self.positions), 1)))

    def with_uv(self, scale: float | tuple[float, float], offset: tuple[float, float] = (0.0, 0.0)) -> Mesh:
        """Return the mesh with its first uv set scaled (positive factors) and shifted."""
        assert self.uv0 is not None
        return replace(self, uv0=self.uv0 * np.asarray(scale, np.float64) + offset)

    def with_turned_uv(self) -> Mesh:
        """Return the mesh with its first uv set turned by a quarter: what ran along v now runs along u."""
        assert self.uv0 is not None
        tangents = self.tangents
        if tangents is not None:
            # The new u grows where v grew, which is down in the old texture: against the bitangent.
            down = -np.cross(self.normals, tangents[:, :3]) * tangents[:, 3:]
            tangents = np.concatenate([down, tangents[:, 3:]], axis=1)
        return replace(self, uv0=np.stack([self.uv0[:, 1], -self.uv0[:, 0]], -1), tangents=tangents)


def rotation_y(degrees: float) -> Float64:
    """Return the (3, 3) rotation about +y, exact for quarter turns."""
    c, s = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    if degrees % 90 == 0:
        c, s = round(c), round(s)
    return np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]], np.float64)


def join(*meshes: Mesh) -> Mesh:
    """Return one mesh of several; an optional attribute is kept only if all of them have it."""
    offsets = np.cumsum([0, *(len(m.positions) for m in meshes)])

    def stack(name: str) -> Float64 | None:
        arrays = [getattr(m, name) for m in meshes]
        return None if any(a is None for a in arrays) else np.concatenate(arrays)

    triangles = np.concatenate([m.triangles + o for m, o in zip(meshes, offsets, strict=False)])
    positions = np.concatenate([m.positions for m in meshes])
    normals = np.concatenate([m.normals for m in meshes])
    return Mesh(positions, normals, triangles, stack("uv0"), stack("tangents"), stack("uv1"), stack("colors"))


def normalized(vectors: Float64) -> Float64:
    """Return vectors (..., 3) of unit length; zero vectors stay zero."""
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return vectors / np.where(length > 0, length, 1.0)


def _slopes(points: Float64, axis: int) -> Float64:
    """Return central differences along a grid axis, one-sided at the ends and where neighbours coincide."""
    padded = np.moveaxis(points, axis, 0)
    slope = np.empty_like(padded)
    slope[1:-1] = padded[2:] - padded[:-2]
    slope[0], slope[-1] = padded[1] - padded[0], padded[-1] - padded[-2]
    return np.moveaxis(slope, 0, axis)


def surface(points: Float64, uv: Float64, normals: Float64 | None = None) -> Mesh:
    """Return the grid `points` (..., R, C, 3) as a mesh with `uv` (..., R, C, 2); leading axes hold several grids.

    Normals (..., R, C, 3), if not given, follow each grid's own slope. Triangles with two equal corners are left out,
    so that a row may shrink to a point.
    """
    along_u, along_v = _slopes(points, -2), _slopes(points, -3)
    if normals is None:
        normals = np.cross(along_v, along_u)
    normals = normalized(normals)
    uv_u, uv_v = _slopes(uv, -2), _slopes(uv, -3)
    # dP/du and dP/dv of the texture from the grid's slopes; the common factor's sign tells a mirrored chart.
    area = uv_u[..., 0] * uv_v[..., 1] - uv_u[..., 1] * uv_v[..., 0]
    sign = np.where(area < 0, -1.0, 1.0)
    tangent = (along_u * uv_v[..., 1:] - along_v * uv_u[..., 1:]) * sign[..., None]
    tangent = normalized(tangent - normals * (tangent * normals).sum(-1, keepdims=True))
    missing = (np.abs(tangent).sum(-1) == 0)[..., None]
    fallback = np.cross(normals, np.where(np.abs(normals[..., 1:2]) < 0.9, [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]))
    tangent = np.where(missing, normalized(fallback), tangent)
    index = np.arange(points.size // 3).reshape(points.shape[:-1])
    a, b = index[..., :-1, :-1], index[..., :-1, 1:]
    c, d = index[..., 1:, :-1], index[..., 1:, 1:]
    triangles = np.concatenate(
        [np.stack([a, c, d], -1).reshape(-1, 3), np.stack([a, d, b], -1).reshape(-1, 3)], axis=1
    ).reshape(-1, 3)
    flat = points.reshape(-1, 3)
    corner = np.round(flat * 4096).astype(np.int64)[triangles]
    equal = [(corner[:, i] == corner[:, j]).all(-1) for i, j in ((0, 1), (1, 2), (2, 0))]
    triangles = triangles[~(equal[0] | equal[1] | equal[2])]
    tangents = np.concatenate([tangent, sign[..., None]], axis=-1).reshape(-1, 4)
    return Mesh(flat, normals.reshape(-1, 3), triangles, uv.reshape(-1, 2), tangents)


def quad(corner: Vector, right: Vector, down: Vector, cells: int = 1) -> Mesh:
    """Return a flat rectangle seen from the side where `right` points right and `down` down; uv in metres."""
    corner_, right_, down_ = (np.asarray(x, np.float64) for x in (corner, right, down))
    t = np.linspace(0.0, 1.0, cells + 1)
    v, u = np.meshgrid(t, t, indexing="ij")
    points = corner_ + u[..., None] * right_ + v[..., None] * down_
    uv = np.stack([u * np.linalg.norm(right_), v * np.linalg.norm(down_)], -1)
    return surface(points, uv)


def box(low: Vector, high: Vector, faces: str = "xXyYzZ") -> Mesh:
    """Return the box between two corners; `faces` names those wanted (capitals: the positive side). uv in metres."""
    (x0, y0, z0), (x1, y1, z1) = low, high
    dx, dy, dz = x1 - x0, y1 - y0, z1 - z0
    sides = {
        "Z": ((x0, y1, z1), (dx, 0, 0), (0, -dy, 0)),
        "z": ((x1, y1, z0), (-dx, 0, 0), (0, -dy, 0)),
        "X": ((x1, y1, z1), (0, 0, -dz), (0, -dy, 0)),
        "x": ((x0, y1, z0), (0, 0, dz), (0, -dy, 0)),
        "Y": ((x0, y1, z0), (dx, 0, 0), (0, 0, dz)),
        "y": ((x0, y0, z1), (dx, 0, 0), (0, 0, -dz)),
    }
    return join(*(quad(*sides[face]) for face in faces))


def lathe(
    profile: Sequence[Sequence[tuple[float, float]]],
    segments: int,
    repeat: tuple[float, float] = (1.0, 1.0),
    faceted: bool = False,
) -> Mesh:
    """Turn `profile` about the y axis: runs of (radius, height) from top to bottom, smooth within, creased between.

    u goes `repeat[0]` times around, v counts metres of the profile's length times `repeat[1]`. A faceted lathe is a
    prism: flat around, with its first corner towards +z.
    """
    angle = np.linspace(0.0, 2 * np.pi, segments + 1)
    c, s = np.cos(angle), np.sin(angle)
    c[-1], s[-1] = c[0], s[0]
    middle = (angle[:-1] + angle[1:]) / 2
    spans = [slice(i, i + 2) for i in range(segments)] if faceted else [slice(None)]
    parts, length = [], 0.0
    for run in profile:
        r, y = (values[:, None] for values in np.array(run, np.float64).T)
        steps = np.hypot(np.diff(r[:, 0]), np.diff(y[:, 0]))
        v = length + np.concatenate([[0.0], np.cumsum(steps)])
        length = v[-1]
        # The outward normal of a step down along the profile, averaged at the points between two steps.
        step = normalized(np.stack([-np.diff(y[:, 0]), np.diff(r[:, 0]), np.zeros(len(steps))], -1))
        mean = normalized(np.concatenate([step[:1], step[:-1] + step[1:], step[-1:]]))
        for number, span in enumerate(spans):
            facing = np.full(2, middle[number]) if faceted else angle
            ns, nc = (np.sin(facing), np.cos(facing)) if faceted else (s, c)
            points = np.stack(np.broadcast_arrays(r * s[span], y, r * c[span]), -1)
            normals = np.stack(np.broadcast_arrays(mean[:, :1] * ns, mean[:, 1:2], mean[:, :1] * nc), -1)
            u = np.linspace(0.0, repeat[0], segments + 1)[span]
            parts.append(
                surface(points, np.stack(np.broadcast_arrays(u, v[:, None] * repeat[1]), -1), normals)
            )
    return join(*parts)


def arc(
    center: tuple[float, float], radius: float, start_degrees: float, end_degrees: float, steps: int
) -> list[tuple[float, float]]:
    """Return points of a circle for a profile, `steps` + 1 of them; 0 degrees points outwards, 90 up."""
    angle = np.radians(np.linspace(start_degrees, end_degrees, steps + 1))
    return [(center[0] + radius * float(np.cos(a)), center[1] + radius * float(np.sin(a))) for a in angle]


def extrude(profile: Sequence[Sequence[tuple[float, float]]], length: float) -> Mesh:
    """Draw `profile` along x, centred: runs of (z, y) from top to bottom seen from +z, with creases between them.

    uv in metres.
    """
    parts, covered = [], 0.0
    x = np.array([-length / 2, length / 2])
    for run in profile:
        z, y = (values[:, None] for values in np.array(run, np.float64).T)
        v = covered + np.concatenate([[0.0], np.cumsum(np.hypot(np.diff(z[:, 0]), np.diff(y[:, 0])))])
        covered = v[-1]
        points = np.stack(np.broadcast_arrays(x, y, z), -1)
        parts.append(surface(points, np.stack(np.broadcast_arrays(x, v[:, None]), -1)))
    return join(*parts)


def tube(path: Float64, radius: float, sides: int, closed: bool = False, repeat: float = 1.0) -> Mesh:
    """Return a round tube along `path` (N, 3); a closed path's last point is joined to its first. uv in metres.

    The cross-section is kept upright: its second axis is as near to +y as the path allows.
    """
    path = np.asarray(path, np.float64)
    if closed:
        path = np.concatenate([path, path[:1]])
    forward = _slopes(path, 0)
    if closed:
        forward[0] = forward[-1] = path[1] - path[-2]
    forward = normalized(forward)
    up = np.where(np.abs(forward[:, 1:2]) < 0.95, [0.0, 1.0, 0.0], [1.0, 0.0, 0.0])
    right = normalized(np.cross(forward, up))
    up = np.cross(right, forward)
    angle = np.linspace(0.0, 2 * np.pi, sides + 1)
    c, s = np.cos(angle)[:, None], np.sin(angle)[:, None]
    c[-1], s[-1] = c[0], s[0]
    normals = right[:, None] * c + up[:, None] * s
    points = path[:, None] + radius * normals
    steps = np.linalg.norm(np.diff(path, axis=0), axis=1)
    v = np.concatenate([[0.0], np.cumsum(steps)]) * repeat
    u = np.linspace(0.0, 2 * np.pi * radius, sides + 1) * repeat
    uv = np.stack(np.broadcast_arrays(u[None, :], v[:, None]), -1)
    return surface(points, uv, normals)


def sphere(radius: float, segments: int, rings: int) -> Mesh:
    """Return a sphere about the origin whose first uv set is longitude and latitude in 0..1."""
    polar = np.linspace(0.0, np.pi, rings + 1)
    around = np.linspace(0.0, 2 * np.pi, segments + 1)
    sin_polar = np.sin(polar)
    sin_polar[-1] = 0.0
    s, c = np.sin(around), np.cos(around)
    s[-1], c[-1] = s[0], c[0]
    normals = np.stack(
        [
            sin_polar[:, None] * s,
            np.broadcast_to(np.cos(polar)[:, None], (rings + 1, segments + 1)),
            sin_polar[:, None] * c,
        ],
        -1,
    )
    uv = np.stack(np.broadcast_arrays(around / (2 * np.pi), polar[:, None] / np.pi), -1)
    return surface(normals * radius, uv, normals)
