"""Pieces of the city: flat faces, boxes, wall grids and mouldings, collected by material.

A wall is modelled in the frame of its side: x runs to the right along the wall, y upwards, z out of it towards the
viewer, and the wall lies in the plane z = 0. All functions take many pieces at once as arrays.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from assets.noise import Float64
from assets.shapes import Int64, Mesh, Vector, normalized

REPEATS = {
    "asphalt": 1 / 4,
    "paving": 1 / 3,
    "grass": 1 / 6,
    "brick": 1 / 2,
    "plaster": 1 / 4,
    "ashlar": 1 / 2.4,
    "concrete": 1 / 3.6,
    "tiles": 1 / 1.8,
}
"""Repeats per metre of each textured material; others have no use for texture coordinates in metres."""

Color = Sequence[float] | Float64


@dataclass(frozen=True)
class Frame:
    """Where a side of an object lies: the origin (3,) of its plane and a rotation (3, 3) whose columns are x, y, z.

    `wall` says that the plane z = 0 is a wall: what lies behind it gets less light of the sky.
    """

    origin: Float64
    axes: Float64
    wall: bool = True

    def place(self, points: Float64) -> Float64:
        """Return points (..., 3) of this frame in the frame of the object."""
        return points @ self.axes.T + self.origin


_TURNS = [((1, 0), (0, 1)), ((0, -1), (1, 0)), ((-1, 0), (0, -1)), ((0, 1), (-1, 0))]
"""(x, z) of the right and outward directions of the four sides."""


def side_frame(side: int, low: Vector, high: Vector) -> Frame:
    """Return the frame of one side of the box between two corners: 0 faces +z, 1 +x, 2 -z, 3 -x.

    The right end of a side is the left end of the next one.
    """
    (rx, rz), (ox, oz) = _TURNS[side]
    corner = ((low[0], high[2]), (high[0], high[2]), (high[0], low[2]), (low[0], low[2]))[side]
    axes = np.array([[rx, 0, ox], [0, 1, 0], [rz, 0, oz]], np.float64)
    return Frame(np.array([corner[0], low[1], corner[1]], np.float64), axes)


def side_length(side: int, low: Vector, high: Vector) -> float:
    """Return how long that side is, in metres."""
    axis = 0 if side % 2 == 0 else 2
    return float(high[axis] - low[axis])


OBJECT = Frame(np.zeros(3), np.eye(3), wall=False)
"""The frame of the object itself."""


class Parts:
    """The triangles of one object, collected by material."""

    def __init__(self) -> None:
        self._pieces: dict[str, list[_Piece]] = {}
        self._joined: list[tuple[str, Mesh]] | None = None

    def add(self, material: str, *meshes: Mesh) -> None:
        """Add meshes that have colours; texture coordinates are optional."""
        for mesh in meshes:
            assert mesh.colors is not None
            uv = np.zeros((len(mesh.positions), 2)) if mesh.uv0 is None else mesh.uv0
            self._put(material, (mesh.positions, mesh.normals, mesh.triangles, uv, mesh.colors[:, :3]))

    def _put(self, material: str, piece: _Piece) -> None:
        self._pieces.setdefault(material, []).append(piece)
        self._joined = None

    def meshes(self) -> list[tuple[str, Mesh]]:
        """Return one mesh for each material, in the order of the names."""
        if self._joined is None:
            self._joined = [(material, _joined(pieces)) for material, pieces in sorted(self._pieces.items())]
        return self._joined

    @property
    def triangles(self) -> int:
        """How many triangles there are in all meshes."""
        return sum(len(mesh.triangles) for _, mesh in self.meshes())

    def quads(
        self, material: str, frame: Frame, corners: Float64, color: Color, uv: Float64 | None = None
    ) -> None:
        """Add flat faces (N, 4, 3) whose corners run counter-clockwise seen from outside.

        `color` is linear rgb, (3,), (N, 3) or (N, 4, 3). Without `uv` (N, 4, 2) the texture is projected along the axis
        of the frame that a face is turned to most. Two neighbouring corners may be the same: that face is a triangle.
        """
        corners = np.asarray(corners, np.float64)
        if not len(corners):
            return
        normal = normalized(cross(corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1]))
        color = np.asarray(color, np.float64)
        if color.ndim < 3:
            color = color[..., None, :]
        color = color * _shade(corners, normal, frame.wall)[..., None]
        if uv is None:
            uv = box_uv(corners, normal[:, None]) * REPEATS.get(material, 1.0)
        triangles = (4 * np.arange(len(corners))[:, None, None] + _HALVES).reshape(-1, 3)
        normals = np.repeat(normal @ frame.axes.T, 4, 0)
        positions = frame.place(corners.reshape(-1, 3))
        self._put(material, (positions, normals, triangles, uv.reshape(-1, 2), color.reshape(-1, 3)))

    def grid(
        self, material: str, frame: Frame, xs: Float64, ys: Float64, holes: NDArrayBool | None, color: Color
    ) -> None:
        """Add a wall in the plane z = 0 between lines at `xs` (C,) and `ys` (R,), which all run through.

        Cells where `holes` (R - 1, C - 1) is true are open.
        """
        y, x = np.meshgrid(ys, xs, indexing="ij")
        points = np.stack([x, y, np.zeros_like(x)], -1).reshape(-1, 3)
        index = np.arange(len(points)).reshape(x.shape)
        cells = np.stack([index[:-1, :-1], index[:-1, 1:], index[1:, 1:], index[1:, :-1]], -1).reshape(-1, 4)
        if holes is not None:
            cells = cells[~holes.ravel()]
        triangles = cells[:, _HALVES].reshape(-1, 3)
        normals = np.broadcast_to(frame.axes[:, 2], points.shape)
        colors = np.broadcast_to(np.asarray(color, np.float64), points.shape)
        uv = points[:, :2] * [1.0, -1.0] * REPEATS.get(material, 1.0)
        self._put(material, (frame.place(points), normals, triangles, uv, colors))

    def boxes(
        self,
        material: str,
        frame: Frame,
        low: ArrayLike,
        high: ArrayLike,
        color: Color,
        faces: str = "xXyYzZ",
    ) -> None:
        """Add the boxes between corners `low` and `high` (N, 3); `faces` as in `shapes.box`; color (3,) or (N, 3)."""
        both = np.stack([np.atleast_2d(np.asarray(x, np.float64)) for x in (low, high)], 1)  # (N, 2, 3)
        count = len(both)
        picks = np.array([_FACES[face] for face in faces])  # (F, 4, 3)
        corners = both[:, picks, np.arange(3)]  # (N, F, 4, 3)
        color = np.asarray(color, np.float64)
        if color.ndim == 2:
            color = np.repeat(color, len(faces), axis=0)
        self.quads(material, frame, corners.reshape(count * len(faces), 4, 3), color)

    def moulding(
        self,
        material: str,
        frame: Frame,
        ends: tuple[float, float],
        profile: Sequence[tuple[float, float]],
        color: Color,
        mitred: tuple[bool, bool] = (False, False),
    ) -> None:
        """Draw a profile of (z, y), from the bottom outwards and up, along the wall from x = ends[0] to ends[1].

        A mitred end grows with z, and so meets that of the next side at a right angle; another end is closed.
        """
        z, y = np.array(profile, np.float64).T
        left = ends[0] - (z if mitred[0] else 0 * z)
        right = ends[1] + (z if mitred[1] else 0 * z)
        lower, upper = slice(None, -1), slice(1, None)
        start = np.stack([left, y, z], -1)
        end = np.stack([right, y, z], -1)
        faces = [np.stack([start[lower], end[lower], end[upper], start[upper]], 1)]
        inside = np.stack([left, y, 0 * z], -1)
        if not mitred[0]:
            faces.append(np.stack([inside[lower], start[lower], start[upper], inside[upper]], 1))
        inside = np.stack([right, y, 0 * z], -1)
        if not mitred[1]:
            faces.append(np.stack([end[lower], inside[lower], inside[upper], end[upper]], 1))
        corners = np.concatenate(faces)
        flat = np.abs(cross(corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1])).sum(-1) < 1e-6
        self.quads(material, frame, corners[~flat], color)


_Piece = tuple[Float64, Float64, Int64, Float64, Float64]
"""Positions, normals, triangles, texture coordinates and colours (V, 3)."""

_HALVES = np.array([[0, 1, 2], [0, 2, 3]])
"""The two triangles of a face with four corners."""

NDArrayBool = np.ndarray[tuple[int, ...], np.dtype[np.bool_]]

_FACES = {
    "Z": ((0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1)),
    "z": ((1, 0, 0), (0, 0, 0), (0, 1, 0), (1, 1, 0)),
    "X": ((1, 0, 1), (1, 0, 0), (1, 1, 0), (1, 1, 1)),
    "x": ((0, 0, 0), (0, 0, 1), (0, 1, 1), (0, 1, 0)),
    "Y": ((0, 1, 1), (1, 1, 1), (1, 1, 0), (0, 1, 0)),
    "y": ((0, 0, 0), (1, 0, 0), (1, 0, 1), (0, 0, 1)),
}
"""Of each corner of a face, whether it takes x, y and z from the low or the high corner of the box."""


def _joined(pieces: Sequence[_Piece]) -> Mesh:
    """Return one mesh of several, without triangles that have two equal corners and without unused vertices."""
    offsets = np.cumsum([0, *(len(piece[0]) for piece in pieces)])
    triangles = np.concatenate([piece[2] + offset for piece, offset in zip(pieces, offsets, strict=False)])
    points, normals, uv, colors = (np.concatenate([piece[k] for piece in pieces]) for k in (0, 1, 3, 4))
    corner = np.round(points * 4096).astype(np.int64)[triangles]
    equal = (corner == corner[:, [1, 2, 0]]).all(-1).any(-1)
    triangles = triangles[~equal]
    used = np.zeros(len(points), bool)
    used[triangles] = True
    place = np.cumsum(used) - 1
    rgba = np.concatenate([np.clip(colors[used], 0, 1), np.ones((int(used.sum()), 1))], 1)
    return Mesh(points[used], normals[used], place[triangles], uv[used], colors=rgba)


def cross(a: Float64, b: Float64) -> Float64:
    """Return the cross products of vectors (N, 3), several times faster than numpy's."""
    ax, ay, az = a.T
    bx, by, bz = b.T
    return np.stack([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx], -1)


def box_uv(points: Float64, normal: Float64) -> Float64:
    """Return texture coordinates (..., 2) in metres: points projected along the axis nearest to their normal."""
    size = np.abs(normal)
    across, up, out = size[..., 0], size[..., 1], size[..., 2]
    level = (up > across) & (up > out)
    sideways = (across > out) & ~level
    x, y, z = points[..., 0], points[..., 1], points[..., 2]
    return np.stack([np.where(sideways, z, x), np.where(level, -z, -y)], -1)


def _shade(corners: Float64, normal: Float64, wall: bool) -> Float64:
    """Return (N, 4) how much light of the sky reaches corners: less in recesses of the wall, and below ledges.

    It stands in for the occlusion of light from the sky, which no early chapter computes.
    """
    deep = np.clip(-corners[..., 2] / 0.5, 0.0, 1.0) if wall else np.zeros(corners.shape[:2])
    below = np.where(normal[:, None, 1] < -0.5, 0.6, 1.0)
    return (1.0 - 0.45 * deep) * below
