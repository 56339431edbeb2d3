"""Vectors, quaternions, matrices and projections: the linear algebra of the whole project, in float64.

Conventions. The world is right-handed with +y up; a view looks along its -z axis. Matrices are mathematical
arrays named `to_from` that act on column vectors, so the translation is the last column; they are transposed
when uploaded (GLSL stores columns). Quaternions are (x, y, z, w). Angles are radians unless their name ends
in `_deg`. Clip space is Vulkan's, y down and 0 <= z <= w, with reversed depth: 1 at the near plane, 0 at the
far one or at infinity. Leading axes of arguments are batches and broadcast.

pyrr serves here alone, for products of vectors and quaternions. Its matrices are not used, since some of them
act on rows and some on columns; neither are its `slerp`, which interpolates linearly up to 36 degrees, its
`normalize`, which divides the wrong axes of a batch, nor its quaternions of integers, which stay integers.
"""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pyrr import quaternion as pyrr_quaternion
from pyrr import vector3 as pyrr_vector3

Float64 = NDArray[np.float64]

Depth = Literal["reversed", "zero_to_one", "minus_one_to_one"]
"""Reversed-Z, as everywhere in Strata, and the literature's two: standard Vulkan's and OpenGL's."""


_IDENTITY = np.eye(4)

# --- vectors ------------------------------------------------------------------------------------------------


def normalize(vectors: ArrayLike) -> Float64:
    """Return `vectors` (..., C) with length 1 along the last axis; a zero vector stays zero.

    Each is divided by its largest component first, so that lengths of 1e-200 and 1e200 neither vanish nor
    overflow.
    """
    values = np.asarray(vectors, np.float64)
    largest = np.abs(values).max(axis=-1, keepdims=True)
    values = values / np.where(largest > 0, largest, 1.0)
    length = np.sqrt((values * values).sum(axis=-1, keepdims=True))
    return values / np.where(length > 0, length, 1.0)


def transform_points(matrix: ArrayLike, points: ArrayLike) -> Float64:
    """Return points (..., 3) moved by an affine or projective matrix (..., 4, 4), after the division by w."""
    matrix = np.asarray(matrix, np.float64)
    points = np.asarray(points, np.float64)
    moved = np.einsum("...ij,...j->...i", matrix[..., :3], points) + matrix[..., 3]
    return moved[..., :3] / moved[..., 3:]


# --- quaternions --------------------------------------------------------------------------------------------


def quaternion_from_axis_angle(axis: ArrayLike, angle: ArrayLike) -> Float64:
    """Return the rotation by `angle` (...) about a non-zero `axis` (..., 3), right-handed."""
    half = np.asarray(angle, np.float64)[..., None] / 2
    xyz = normalize(axis) * np.sin(half)
    return np.concatenate([xyz, np.broadcast_to(np.cos(half), (*xyz.shape[:-1], 1))], axis=-1)


def quaternion_multiply(a: ArrayLike, b: ArrayLike) -> Float64:
    """Return the Hamilton product (..., 4): the rotation `b` followed by the rotation `a`."""
    a, b = np.asarray(a, np.float64), np.asarray(b, np.float64)
    if a.ndim == b.ndim == 1:  # one product, as a camera makes each frame: half the time
        return pyrr_quaternion.cross(a, b)
    left, right = np.broadcast_arrays(a, b)
    product = pyrr_quaternion.cross(np.moveaxis(left, -1, 0), np.moveaxis(right, -1, 0))
    return np.moveaxis(product, 0, -1)


def quaternion_conjugate(quaternion: ArrayLike) -> Float64:
    """Return the conjugate (..., 4), which is the inverse rotation of a unit quaternion."""
    return np.asarray(quaternion, np.float64) * (-1.0, -1.0, -1.0, 1.0)


def quaternion_rotate(quaternion: ArrayLike, vectors: ArrayLike) -> Float64:
    """Return `vectors` (..., 3) rotated by unit quaternions (..., 4): v + 2 w (u x v) + 2 u x (u x v)."""
    quaternion = np.asarray(quaternion, np.float64)
    vectors = np.asarray(vectors, np.float64)
    axis, w = quaternion[..., :3], quaternion[..., 3:]
    twice = 2.0 * pyrr_vector3.cross(axis, vectors)
    return vectors + w * twice + pyrr_vector3.cross(axis, twice)


def matrix_from_quaternion(quaternion: ArrayLike) -> Float64:
    """Return rotation matrices (..., 3, 3) of quaternions (..., 4) of any length; zero gives the identity."""
    x, y, z, w = np.moveaxis(normalize(quaternion), -1, 0)
    matrix = np.empty((*x.shape, 3, 3))
    matrix[..., 0, 0] = 1 - 2 * (y * y + z * z)
    matrix[..., 0, 1] = 2 * (x * y - z * w)
    matrix[..., 0, 2] = 2 * (x * z + y * w)
    matrix[..., 1, 0] = 2 * (x * y + z * w)
    matrix[..., 1, 1] = 1 - 2 * (x * x + z * z)
    matrix[..., 1, 2] = 2 * (y * z - x * w)
    matrix[..., 2, 0] = 2 * (x * z - y * w)
    matrix[..., 2, 1] = 2 * (y * z + x * w)
    matrix[..., 2, 2] = 1 - 2 * (x * x + y * y)
    return matrix


def quaternion_from_matrix(matrix: ArrayLike) -> Float64:
    """Return unit quaternions (..., 4) of the rotations in the upper left of `matrix` (..., 3 or 4, 3 or 4).

    The four products of one component with all others can be read off the matrix; the row of the largest
    component is the one that loses no digits (Shepperd 1978).
    """
    m = np.asarray(matrix, np.float64)
    xx, yy, zz = m[..., 0, 0], m[..., 1, 1], m[..., 2, 2]
    products = np.empty((*m.shape[:-2], 4, 4))  # 4 q q^T
    products[..., 0, 0] = 1 + xx - yy - zz
    products[..., 1, 1] = 1 - xx + yy - zz
    products[..., 2, 2] = 1 - xx - yy + zz
    products[..., 3, 3] = 1 + xx + yy + zz
    for i, j in ((0, 1), (0, 2), (1, 2)):
        products[..., i, j] = products[..., j, i] = m[..., i, j] + m[..., j, i]
    for i, j, k in ((0, 2, 1), (1, 0, 2), (2, 1, 0)):
        products[..., i, 3] = products[..., 3, i] = m[..., j, k] - m[..., k, j]
    largest = np.argmax(np.diagonal(products, axis1=-2, axis2=-1), axis=-1)
    row = np.take_along_axis(products, largest[..., None, None], axis=-2)[..., 0, :]
    return normalize(row)


def slerp(a: ArrayLike, b: ArrayLike, t: ArrayLike) -> Float64:
    """Return the rotation a fraction `t` (...) along the shorter arc from `a` to `b` (..., 4).

    The angle comes from the chord (2 asin(|a - b| / 2)): arc cosine of the dot product loses half the digits
    of small angles. Below 1e-6 rad the arc is its chord to the last bit, and the division by its sine is left
    out.
    """
    a, b = np.asarray(a, np.float64), np.asarray(b, np.float64)
    t = np.asarray(t, np.float64)[..., None]
    b = np.where((a * b).sum(axis=-1, keepdims=True) < 0, -b, b)
    chord = np.sqrt(((a - b) ** 2).sum(axis=-1, keepdims=True))
    angle = 2 * np.arcsin(np.minimum(chord / 2, 1.0))
    straight = angle < 1e-6
    sine = np.where(straight, 1.0, np.sin(angle))
    weight_a = np.where(straight, 1 - t, np.sin((1 - t) * angle) / sine)
    weight_b = np.where(straight, t, np.sin(t * angle) / sine)
    return normalize(weight_a * a + weight_b * b)


# --- matrices -----------------------------------------------------------------------------------------------


def translation(offset: ArrayLike) -> Float64:
    """Return the matrix (..., 4, 4) that moves points by `offset` (..., 3)."""
    offset = np.asarray(offset, np.float64)
    matrix = np.empty((*offset.shape[:-1], 4, 4))
    matrix[...] = _IDENTITY
    matrix[..., :3, 3] = offset
    return matrix


def rotation(axis: ArrayLike, angle: ArrayLike) -> Float64:
    """Return the matrix (..., 4, 4) that rotates by `angle` radians about `axis` (..., 3)."""
    return compose((0.0, 0.0, 0.0), quaternion_from_axis_angle(axis, angle), (1.0, 1.0, 1.0))


def compose(translation: ArrayLike, rotation: ArrayLike, scale: ArrayLike) -> Float64:
    """Return T R S (..., 4, 4) from translation (..., 3), quaternion (..., 4) and scale (..., 3)."""
    offset, factor = np.asarray(translation, np.float64), np.asarray(scale, np.float64)
    linear = matrix_from_quaternion(rotation) * factor[..., None, :]
    matrix = np.zeros((*np.broadcast_shapes(linear.shape[:-2], offset.shape[:-1]), 4, 4))
    matrix[..., :3, :3] = linear
    matrix[..., :3, 3] = offset
    matrix[..., 3, 3] = 1.0
    return matrix


def decompose(matrix: ArrayLike) -> tuple[Float64, Float64, Float64]:
    """Return translation (..., 3), unit quaternion (..., 4) and scale (..., 3) of T R S matrices (..., 4, 4).

    A mirrored matrix gets a negative x scale; where a scale is zero, some rotation that fits the other axes
    is returned. Shear has no place in these parts: of a sheared matrix this is the rotation closest to its
    axes.
    """
    matrix = np.asarray(matrix, np.float64)
    scale = np.linalg.norm(matrix[..., :3, :3], axis=-2)
    scale[..., 0] *= np.where(np.linalg.det(matrix[..., :3, :3]) < 0, -1.0, 1.0)
    # Axes of length 1 first: the singular vectors of an axis 1e-10 as long as another would keep six digits.
    axes = matrix[..., :3, :3] / np.where(scale != 0, scale, 1.0)[..., None, :]
    u, _, v = np.linalg.svd(axes)
    u[..., :, 2] *= np.linalg.det(u @ v)[..., None]  # the freedom of a singular matrix is in the last column
    return matrix[..., :3, 3].copy(), quaternion_from_matrix(u @ v), scale


def invert_rigid(matrix: ArrayLike) -> Float64:
    """Return the inverse of rotations with translation (..., 4, 4), exact to the last bit in the rotation."""
    matrix = np.asarray(matrix, np.float64)
    inverse = np.zeros_like(matrix)
    inverse[..., :3, :3] = matrix[..., :3, :3].swapaxes(-1, -2)
    inverse[..., :3, 3] = -np.einsum("...ji,...j->...i", matrix[..., :3, :3], matrix[..., :3, 3])
    inverse[..., 3, 3] = 1.0
    return inverse


def normal_matrix(world_from_object: ArrayLike) -> Float64:
    """Return the matrices (..., 3, 3) that carry normals, up to a positive factor: normalise what they give.

    A normal transforms by the inverse transpose M^-T = cof(M) / det(M). The cofactor matrix exists for every
    M, so an object flattened to a plane keeps its normals; the sign of det(M) makes a mirrored object's
    normals point outwards as M^-T does. The factor makes the largest entry 1, so nothing leaves float32. Rank
    1 or 0 (a line, a point) has no normals, and the result is zero.
    """
    m = np.asarray(world_from_object, np.float64)[..., :3, :3]
    m = m / _largest_entry(m)
    columns = [np.cross(m[..., :, (i + 1) % 3], m[..., :, (i + 2) % 3]) for i in range(3)]
    cofactors = np.stack(columns, axis=-1)
    determinant = (m[..., :, 0] * columns[0]).sum(axis=-1)
    sign = np.where(determinant < 0, -1.0, 1.0)
    return sign[..., None, None] * cofactors / _largest_entry(cofactors)


def _largest_entry(matrices: Float64) -> Float64:
    largest = np.abs(matrices).max(axis=(-2, -1), keepdims=True)
    return np.where(largest > 0, largest, 1.0)


def pose_looking_at(eye: ArrayLike, target: ArrayLike, up: ArrayLike = (0.0, 1.0, 0.0)) -> Float64:
    """Return `world_from_view` (4, 4): at `eye`, -z towards `target`, +y as near to `up` as that allows.

    Where the direction is (anti)parallel to `up`, the world axis farthest from it takes the place of `up`.
    Raises ValueError if eye and target are the same point.
    """
    eye = np.asarray(eye, np.float64)
    backward = normalize(eye - np.asarray(target, np.float64))
    if not backward.any():
        raise ValueError(f"a view from {eye.tolist()} to the same point has no direction")
    up = normalize(up)
    right = pyrr_vector3.cross(up, backward)
    if np.linalg.norm(right) < 1e-9:
        right = pyrr_vector3.cross(np.eye(3)[np.argmin(np.abs(backward))], backward)
    right = normalize(right)
    pose = np.eye(4)
    pose[:3, 0] = right
    pose[:3, 1] = pyrr_vector3.cross(backward, right)
    pose[:3, 2] = backward
    pose[:3, 3] = eye
    return pose


def look_at(eye: ArrayLike, target: ArrayLike, up: ArrayLike = (0.0, 1.0, 0.0)) -> Float64:
    """Return `view_from_world` (4, 4), the inverse of `pose_looking_at`."""
    return invert_rigid(pose_looking_at(eye, target, up))


# --- projections --------------------------------------------------------------------------------------------


def perspective(yfov: float, aspect: float, near: float) -> Float64:
    """Return `clip_from_view` (4, 4) of an infinite perspective view with reversed depth.

    `yfov` is the whole vertical angle, `aspect` width / height, `near` metres. Depth is near / distance: a
    float32 near zero has small steps, so far things keep their order, which they lose near one (Reed 2015,
    "Depth precision visualized").
    """
    if not 0 < yfov < np.pi or not aspect > 0 or not near > 0:
        raise ValueError(f"no perspective has yfov {yfov}, aspect {aspect} and near {near}")
    focal = 1.0 / np.tan(yfov / 2)
    return np.array(
        [[focal / aspect, 0, 0, 0], [0, -focal, 0, 0], [0, 0, 0, near], [0, 0, -1, 0]], np.float64
    )


def orthographic(ymag: float, aspect: float, near: float, far: float) -> Float64:
    """Return `clip_from_view` (4, 4) of an orthographic view with reversed depth, 1 at `near` and 0 at `far`.

    `ymag` is half the height of the view in metres, as in glTF; `near` and `far` are distances along -z.
    """
    if not ymag > 0 or not aspect > 0 or not np.isfinite(far - near) or not far > near:
        raise ValueError(f"no orthographic view has ymag {ymag}, aspect {aspect}, near {near} and far {far}")
    depth = far - near
    return np.array(
        [[1 / (ymag * aspect), 0, 0, 0], [0, -1 / ymag, 0, 0], [0, 0, 1 / depth, far / depth], [0, 0, 0, 1]],
        np.float64,
    )


def frustum_planes(clip_from_world: ArrayLike, depth: Depth = "reversed") -> Float64:
    """Return the planes (..., P, 4) of a frustum as (n, d), |n| = 1.

    A point p is inside where n.p + d >= 0 for all. The order is left, right, bottom, top (of clip space),
    near, far. Each is a sum of rows of the matrix (Gribb and Hartmann 2001): -w <= x <= w gives r3 + r0 and
    r3 - r0. The near plane is r3 - r2 for reversed depth, and r2 or r3 + r2 for the standard 0..1 and -1..1.
    An infinite view has no far plane, and P is 5 instead of 6.
    """
    r0, r1, r2, r3 = np.moveaxis(np.asarray(clip_from_world, np.float64), -2, 0)
    ends = {"reversed": (r3 - r2, r2), "zero_to_one": (r2, r3 - r2), "minus_one_to_one": (r3 + r2, r3 - r2)}[
        depth
    ]
    planes = np.stack([r3 + r0, r3 - r0, r3 + r1, r3 - r1, *ends], axis=-2)
    length = np.linalg.norm(planes[..., :3], axis=-1, keepdims=True)
    if (length[..., 5, 0] == 0).all():
        planes, length = planes[..., :5, :], length[..., :5, :]
    return planes / length


def frustum_corners(
    clip_from_world: ArrayLike, depth: Depth = "reversed", far_ndc: float | None = None
) -> Float64:
    """Return the corners (..., 8, 3) of a frustum: four of the near plane, then the four behind them.

    Each four go (-1, -1), (1, -1), (1, 1), (-1, 1) in x and y of clip space. `far_ndc` puts the second four
    at a depth of the reader's choice; an infinite view needs it (near / distance), and raises ValueError
    without.
    """
    near_ndc, default = {"reversed": (1.0, 0.0), "zero_to_one": (0.0, 1.0), "minus_one_to_one": (-1.0, 1.0)}[
        depth
    ]
    ends = (near_ndc, default if far_ndc is None else far_ndc)
    square = ((-1, -1), (1, -1), (1, 1), (-1, 1))
    ndc = np.array([(x, y, z, 1.0) for z in ends for x, y in square])
    world = np.einsum("...ij,kj->...ki", np.linalg.inv(np.asarray(clip_from_world, np.float64)), ndc)
    largest = np.abs(world).max(axis=-1)
    if (np.abs(world[..., 3]) <= 1e-14 * largest).any():
        raise ValueError("an infinite view has no far corners: pass far_ndc, which is near / distance")
    return world[..., :3] / world[..., 3:]
