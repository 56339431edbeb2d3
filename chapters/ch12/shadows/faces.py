"""The faces of lights: records of projections, all faces of all lights by operations on whole arrays.

Axes are right-handed: `right` x `down` = `ahead`. A face is `guard` texels wider on each side than what the light
shines into. A filter around any point of it then finds all its taps in the same face.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..scene.packing import LIGHT_KINDS

FACE = np.dtype(
    [
        ("right", np.float32, 3),
        ("scale_x", np.float32),
        ("down", np.float32, 3),
        ("scale_y", np.float32),
        ("ahead", np.float32, 3),
        ("perspective", np.float32),
        ("origin", np.float32, 3),
        ("near", np.float32),
        ("far", np.float32),
        ("guard", np.float32),
        ("offset", np.float32, 2),
        ("first", np.uint32),
        ("tiles", np.uint32),
        ("size", np.uint32),
        ("light", np.uint32),
    ]
)
"""A face as records.glsl has it. `offset` is where it begins in its first tile, in texels; `light` is the place of its
light in the records."""

UNUSED = 0xFFFFFFFF
"""The `light` of a record that is no face."""

Float64 = NDArray[np.float64]

AHEAD = np.array([(1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0), (0, 0, 1), (0, 0, -1)], np.float64)
DOWN = np.array([(0, -1, 0), (0, -1, 0), (0, 0, 1), (0, 0, -1), (0, -1, 0), (0, -1, 0)], np.float64)
"""The axes of a cube's faces, in the order +x, -x, +y, -y, +z, -z."""

WIDEST_SPOT = np.radians(60.0)
"""Half angle beyond which a spot has the six faces of a cube: the texels of one face would be too uneven."""


def axes_of(ahead: Float64) -> Float64:
    """Return (N, 3, 3) float64 axes `right`, `down`, `ahead` as rows, from unit vectors (N, 3).

    Down is as near as possible to -y, or to -z where a light shines along y: a turn about another axis than the light's
    changes them without a jump elsewhere.
    """
    along_y = np.abs(ahead[:, 1]) > 0.99
    below = np.where(along_y[:, None], (0.0, 0.0, -1.0), (0.0, -1.0, 0.0))
    right = np.cross(below, ahead)
    right /= np.linalg.norm(right, axis=1)[:, None]
    return np.stack([right, np.cross(ahead, right), ahead], axis=1)


def cube_axes() -> Float64:
    """Return (6, 3, 3) axes of the faces of a cube as rows."""
    return np.stack([np.cross(DOWN, AHEAD), DOWN, AHEAD], axis=1)


def reaches(lights: np.ndarray) -> Float64:
    """Return (L,) metres beyond which local lights give exactly nothing: range or cutoff, at most 1e18."""
    with np.errstate(divide="ignore"):
        range2 = 1.0 / lights["inverse_range2"].astype(np.float64)
    return np.sqrt(np.minimum(np.minimum(range2, lights["end_distance2"]), 1e36))


def outer_angles(lights: np.ndarray) -> Float64:
    """Return (L,) half angle in radians beyond which a spot gives nothing, from scale and offset of its cosine."""
    scale, offset = lights["cone"][:, 0].astype(np.float64), lights["cone"][:, 1].astype(np.float64)
    with np.errstate(divide="ignore", invalid="ignore"):
        cosine = np.where(scale > 0.0, -offset / scale, 1.0)
    return np.arccos(np.clip(cosine, -1.0, 1.0))


def has_cube(lights: np.ndarray) -> NDArray[np.bool_]:
    """Return (L,) whether a light has the six faces of a cube."""
    spot = lights["kind"] == LIGHT_KINDS["spot"]
    return (lights["kind"] == LIGHT_KINDS["point"]) | (spot & (outer_angles(lights) > WIDEST_SPOT))


def local_faces(
    lights: np.ndarray,
    places: NDArray[np.intp],
    sizes: NDArray[np.int64],
    near: float,
    far: Float64,
    guard: NDArray[np.int64],
) -> tuple[np.ndarray, NDArray[np.intp], NDArray[np.intp]]:
    """Return (F,) FACE records of lights that have a place, in the order of `places` (N,) in `lights`.

    The other two (F,) are for each face the number of its light among these, and its own among the faces of that light.

    `sizes` (N,) are texels along a face of each; `guard` (N,) those
    that only filters reach; `near` and `far` (N,) are in metres. Tiles are not placed yet.
    """
    chosen = lights[places]
    cube = has_cube(chosen)
    counts = np.where(cube, 6, 1)
    owner = np.repeat(np.arange(len(places)), counts)
    number = np.arange(len(owner)) - np.repeat(np.cumsum(counts) - counts, counts)
    faces = np.zeros(len(owner), FACE)
    axes = np.where(
        cube[owner][:, None, None],
        cube_axes()[number],
        axes_of(chosen["direction"].astype(np.float64))[owner],
    )
    half = np.where(cube, np.pi / 4, np.clip(outer_angles(chosen), np.radians(0.5), WIDEST_SPOT))
    set_axes(faces, axes)
    faces["scale_x"] = faces["scale_y"] = ((sizes / 2 - guard) / np.tan(half))[owner]
    faces["perspective"] = 1.0
    faces["origin"] = chosen["position"][owner]
    faces["near"] = near
    faces["far"] = np.maximum(far, 2.0 * near)[owner]
    faces["guard"], faces["size"], faces["light"] = guard[owner], sizes[owner], places[owner]
    return faces, owner, number


def set_axes(faces: np.ndarray, axes: Float64) -> None:
    """Store (F, 3, 3) axes in records."""
    faces["right"], faces["down"], faces["ahead"] = axes[:, 0], axes[:, 1], axes[:, 2]
