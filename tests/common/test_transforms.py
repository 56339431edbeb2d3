"""Transforms against Rodrigues' formula, SciPy's rotations, and the definitions of the conventions."""

from __future__ import annotations

import numpy as np
import pytest

from common.numerics import transforms as tf

RNG = np.random.default_rng(7)
QUATERNIONS = RNG.normal(size=(200, 4))
QUATERNIONS /= np.linalg.norm(QUATERNIONS, axis=1, keepdims=True)


def rodrigues(axis, angle):
    """I + sin(a) K + (1 - cos(a)) K^2, where K v = axis x v."""
    k = np.cross(np.eye(3), np.asarray(axis) / np.linalg.norm(axis))
    return np.eye(3) + np.sin(angle) * k + 2 * np.sin(angle / 2) ** 2 * k @ k


def rotation_of(quaternion):
    """By the meaning of a unit quaternion: axis sin(a/2), cos(a/2)."""
    sine = np.linalg.norm(quaternion[:3])
    return rodrigues(quaternion[:3], 2 * np.arctan2(sine, quaternion[3]))


@pytest.mark.feature("math/matrices-and-quaternions")
def test_quaternions_agree_with_rodrigues():
    a, b = QUATERNIONS[:100], QUATERNIONS[100:]
    matrices = np.array([rotation_of(q) for q in a])
    points = RNG.normal(size=(100, 3))
    assert np.allclose(tf.matrix_from_quaternion(a), matrices, atol=1e-14)
    assert np.allclose(tf.quaternion_rotate(a, points), np.einsum("nij,nj->ni", matrices, points), atol=1e-14)
    product = [rotation_of(p) @ rotation_of(q) for p, q in zip(a, b, strict=True)]
    assert np.allclose(tf.matrix_from_quaternion(tf.quaternion_multiply(a, b)), product, atol=1e-14)
    assert np.allclose(tf.quaternion_multiply(a, tf.quaternion_conjugate(a)), (0, 0, 0, 1), atol=1e-15)
    back = tf.quaternion_from_matrix(matrices)
    assert np.abs(np.abs((back * a).sum(-1)) - 1).max() < 1e-14
    axes, angles = RNG.normal(size=(100, 3)), RNG.uniform(-6, 6, 100)
    expected = [rodrigues(axis, angle) for axis, angle in zip(axes, angles, strict=True)]
    assert np.allclose(tf.rotation(axes, angles)[:, :3, :3], expected, atol=1e-14)


@pytest.mark.needs("scipy")
def test_quaternions_agree_with_scipy():
    from scipy.spatial.transform import Rotation

    a, b = QUATERNIONS[:100], QUATERNIONS[100:]
    points = RNG.normal(size=(100, 3))
    ours = tf.quaternion_multiply(a, b)
    product = (Rotation.from_quat(a) * Rotation.from_quat(b)).as_quat()
    assert np.abs(np.abs((ours * product).sum(-1)) - 1).max() < 1e-14
    assert np.allclose(tf.quaternion_rotate(a, points), Rotation.from_quat(a).apply(points), atol=1e-14)
    assert np.allclose(tf.matrix_from_quaternion(a), Rotation.from_quat(a).as_matrix(), atol=1e-14)
    back = tf.quaternion_from_matrix(Rotation.from_quat(a).as_matrix())
    assert np.abs(np.abs((back * a).sum(-1)) - 1).max() < 1e-14


def test_quaternion_from_matrix_keeps_its_digits_at_half_turns():
    """The trace is -1 there, where the textbook formula divides by zero."""
    for axis in (*np.eye(3), (1, 1, 0), (1, 2, 3), (-1, 1, 1e-9)):
        for angle in (np.pi, np.pi - 1e-9, np.pi - 1e-4):
            turn = rodrigues(axis, angle)
            ours = tf.matrix_from_quaternion(tf.quaternion_from_matrix(turn))
            assert np.abs(ours - turn).max() < 1e-14


@pytest.mark.parametrize("angle", [1e-9, 1e-6, 1e-3, 0.3, 0.6, 2.0, 3.1])
def test_slerp_moves_at_constant_speed(angle):
    """Below 36 degrees pyrr's own would interpolate linearly, off by 1e-4 rad in the middle of each half."""
    axis, a = (1, -2, 3), QUATERNIONS[0]
    b = tf.quaternion_multiply(tf.quaternion_from_axis_angle(axis, angle), a)
    t = np.linspace(0, 1, 11)
    expected = [rodrigues(axis, angle * fraction) @ rotation_of(a) for fraction in t]
    for sign in (1, -1):  # q and -q are the same rotation; the shorter arc is taken for both
        ours = tf.matrix_from_quaternion(tf.slerp(a, sign * b, t))
        assert np.abs(ours - expected).max() < 3e-15


@pytest.mark.feature("math/matrices-and-quaternions")
def test_a_third_of_a_turn_about_the_diagonal_permutes_the_axes():
    turn = tf.rotation((1, 1, 1), np.radians(120))[:3, :3]
    assert np.abs(turn - np.eye(3)[:, [1, 2, 0]]).max() < 1e-15
    assert np.abs(tf.rotation((1, 1, 1), 2 * np.pi) - np.eye(4)).max() < 1e-15


@pytest.mark.feature("math/matrices-and-quaternions")
def test_compose_and_decompose_are_inverse():
    t = RNG.normal(size=(200, 3)) * 1e5
    s = 10.0 ** RNG.uniform(-8, 8, (200, 3))
    matrix = tf.compose(t, QUATERNIONS, s)
    product = np.stack([rotation_of(q) @ np.diag(f) for q, f in zip(QUATERNIONS, s, strict=True)])
    assert np.allclose(matrix[:, :3, :3], product, rtol=1e-12, atol=0)
    t2, q2, s2 = tf.decompose(matrix)
    assert np.array_equal(t2, t)
    assert np.abs(s2 / s - 1).max() < 1e-13
    assert np.abs(np.abs((q2 * QUATERNIONS).sum(-1)) - 1).max() < 1e-13


@pytest.mark.parametrize(
    "scale", [(-1, 2, 3), (2, -3, 4), (-1, -2, -3), (0, 2, 3), (1, 0, 2), (1, 2, 0), (0, 0, 5), (0, 0, 0)]
)
def test_decompose_gives_a_rotation_for_mirrored_and_singular_matrices(scale):
    matrix = tf.compose((1, 2, 3), QUATERNIONS[3], scale)
    t, q, s = tf.decompose(matrix)
    assert np.isfinite(q).all() and abs(np.linalg.norm(q) - 1) < 1e-14
    assert np.abs(tf.compose(t, q, s) - matrix).max() < 1e-13


@pytest.mark.feature("math/normal-matrix")
def test_normals_stay_perpendicular_and_point_outwards():
    linear = RNG.normal(size=(500, 3, 3)) * 10.0 ** RNG.uniform(-3, 3, (500, 1, 3))  # half of them mirrored
    a, b = RNG.normal(size=(2, 500, 3))
    normal = tf.normalize(np.cross(a, b))
    matrix = np.tile(np.eye(4), (500, 1, 1))
    matrix[:, :3, :3] = linear
    moved = tf.normalize(np.einsum("nij,nj->ni", tf.normal_matrix(matrix), normal))
    for tangent in (a, b):
        carried = tf.normalize(np.einsum("nij,nj->ni", linear, tangent))
        assert np.abs((moved * carried).sum(-1)).max() < 1e-6
    expected = tf.normalize(np.einsum("nji,nj->ni", np.linalg.inv(linear), normal))
    assert (moved * expected).sum(-1).min() > 1 - 1e-9
    as_points = tf.normalize(np.einsum("nij,nj->ni", linear, normal))
    assert np.abs((as_points * carried).sum(-1)).max() > 0.5, (
        "normals that are moved as points are moved lean over"
    )


def test_normal_matrix_survives_flattened_and_tiny_objects():
    flat = tf.normal_matrix(np.diag([2.0, 0.0, 3.0]))
    assert np.array_equal(flat, np.diag([0.0, 1.0, 0.0]))
    tiny = tf.normal_matrix(np.diag([1e-30, 2e-30, 4e-30]))
    assert np.allclose(tiny, np.diag([1.0, 0.5, 0.25]))
    assert np.array_equal(tf.normal_matrix(np.zeros((3, 3))), np.zeros((3, 3)))


@pytest.mark.feature("math/matrices-and-quaternions")
def test_look_at_puts_the_target_on_the_axis():
    eye, target = np.array([3.0, 4.0, -5.0]), np.array([-1.0, 2.0, 8.0])
    view = tf.look_at(eye, target)
    distance = np.linalg.norm(target - eye)
    assert np.abs(tf.transform_points(view, target) - (0, 0, -distance)).max() < 1e-14
    assert np.abs(tf.transform_points(view, eye)).max() < 1e-14
    assert (
        tf.transform_points(view, eye + np.array([0, 1, 0]))[1] > 0 and abs((view @ (0, 1, 0, 0))[0]) < 1e-15
    )
    assert np.abs(view @ tf.pose_looking_at(eye, target) - np.eye(4)).max() < 1e-14
    assert abs(np.linalg.det(view[:3, :3]) - 1) < 1e-14


@pytest.mark.parametrize("target", [(0, 1, 0), (0, -7, 0)])
def test_looking_straight_up_or_down_is_a_rotation_too(target):
    pose = tf.pose_looking_at((0, 0, 0), target)
    assert np.abs(pose[:3, :3] @ pose[:3, :3].T - np.eye(3)).max() < 1e-15
    assert np.linalg.det(pose) == pytest.approx(1) and np.array_equal(-pose[:3, 2], tf.normalize(target))
    with pytest.raises(ValueError, match="no direction"):
        tf.look_at((1, 2, 3), (1, 2, 3))


@pytest.mark.feature("math/matrices-and-quaternions")
def test_perspective_meets_its_definition():
    yfov, aspect, near = np.radians(50), 16 / 9, 0.1
    clip = tf.perspective(yfov, aspect, near)
    for distance in (near, 1.0, 1e3, 1e9):
        top = distance * np.tan(yfov / 2)
        ndc = tf.transform_points(clip, (top * aspect, top, -distance))
        assert np.allclose(ndc, (1, -1, near / distance), rtol=1e-14)  # +y is up, and up is -1 in Vulkan
    assert (clip @ (0, 0, -1, 0))[2] == 0  # a direction, at infinity


@pytest.mark.feature("math/matrices-and-quaternions")
def test_orthographic_meets_its_definition():
    clip = tf.orthographic(2.0, 1.5, 0.5, 20.0)
    assert np.allclose(tf.transform_points(clip, (3, 2, -0.5)), (1, -1, 1), atol=1e-15)
    assert np.allclose(tf.transform_points(clip, (-3, -2, -20)), (-1, 1, 0), atol=1e-15)
    assert np.allclose(tf.transform_points(clip, (0, 0, -10.25)), (0, 0, 0.5), atol=1e-15)


@pytest.mark.feature("math/matrices-and-quaternions")
def test_projections_refuse_what_has_no_volume():
    for wrong in ((0, 1, 0.1), (np.pi, 1, 0.1), (1, 0, 0.1), (1, 1, 0), (np.nan, 1, 1)):
        with pytest.raises(ValueError, match="no perspective"):
            tf.perspective(*wrong)
    for wrong in ((0, 1, 0, 1), (1, 1, 1, 1), (1, 1, 0, np.inf), (1, 1, np.nan, 1)):
        with pytest.raises(ValueError, match="no orthographic"):
            tf.orthographic(*wrong)


def _standard(depth):
    """The literature's finite projections (y up): z from near to far is 0..1, or -1..1."""
    f, n, a = 100.0, 0.5, 1.3
    focal = 1 / np.tan(0.4)
    z = {
        "zero_to_one": (f / (n - f), n * f / (n - f)),
        "minus_one_to_one": ((f + n) / (n - f), 2 * f * n / (n - f)),
    }
    return np.array([[focal / a, 0, 0, 0], [0, focal, 0, 0], [0, 0, *z[depth]], [0, 0, -1, 0]])


@pytest.mark.feature("math/frustum-planes")
@pytest.mark.parametrize("depth", ["reversed", "zero_to_one", "minus_one_to_one"])
def test_corners_lie_on_three_planes_each(depth):
    projection = tf.orthographic(2, 1.5, 0.5, 20) if depth == "reversed" else _standard(depth)
    clip_from_world = projection @ tf.look_at((3, 4, -5), (-1, 2, 8))
    planes = tf.frustum_planes(clip_from_world, depth)
    corners = tf.frustum_corners(clip_from_world, depth)
    assert planes.shape == (6, 4) and np.allclose(np.linalg.norm(planes[:, :3], axis=1), 1)
    distances = corners @ planes[:, :3].T + planes[:, 3]
    touching = np.abs(distances) < 1e-9
    assert (touching.sum(axis=1) == 3).all() and (touching.sum(axis=0) == 4).all()
    assert touching[:4, 4].all() and touching[4:, 5].all()
    assert (distances > -1e-9).all()
    near_distance = -tf.transform_points(tf.look_at((3, 4, -5), (-1, 2, 8)), corners[:4])[:, 2]
    assert np.allclose(near_distance, 0.5)


@pytest.mark.feature("math/frustum-planes")
def test_an_infinite_view_has_five_planes():
    near, far = 0.2, 1e4
    clip_from_world = tf.perspective(1.0, 1.5, near) @ tf.look_at((3, 4, -5), (-1, 2, 8))
    planes = tf.frustum_planes(clip_from_world)
    assert planes.shape == (5, 4)
    with pytest.raises(ValueError, match="far_ndc"):
        tf.frustum_corners(clip_from_world)
    corners = tf.frustum_corners(clip_from_world, far_ndc=near / far)
    distances = corners @ planes[:, :3].T + planes[:, 3]
    assert (np.abs(distances[:4]) < 1e-9).sum(axis=1).tolist() == [3] * 4
    assert (np.abs(distances[4:]) < 1e-9 * far).sum(axis=1).tolist() == [2] * 4
    assert np.allclose(distances[4:, 4], far - near, rtol=1e-9)
    inside = RNG.uniform(-1, 1, (1000, 3)) * 50
    ndc = np.einsum("ij,nj->ni", clip_from_world, np.c_[inside, np.ones(1000)])
    visible = (np.abs(ndc[:, :2]) <= ndc[:, 3:]).all(axis=1) & (ndc[:, 2] <= ndc[:, 3])
    assert np.array_equal((inside @ planes[:, :3].T + planes[:, 3] >= 0).all(axis=1), visible)
    assert 10 < visible.sum() < 990


def test_batches_equal_single_calls():
    matrices = tf.compose(RNG.normal(size=(4, 5, 3)), QUATERNIONS[:20].reshape(4, 5, 4), np.ones(3))
    assert np.allclose(tf.invert_rigid(matrices) @ matrices, np.eye(4), atol=1e-14)
    clip = tf.orthographic(1, 1, 0, 1) @ matrices
    planes, corners = tf.frustum_planes(clip), tf.frustum_corners(clip)
    assert planes.shape == (4, 5, 6, 4) and corners.shape == (4, 5, 8, 3)
    assert np.allclose(planes[2, 3], tf.frustum_planes(clip[2, 3])) and np.allclose(
        corners[2, 3], tf.frustum_corners(clip[2, 3])
    )
    assert np.array_equal(tf.normal_matrix(matrices)[1, 2], tf.normal_matrix(matrices[1, 2]))
    assert tf.translation(RNG.normal(size=(4, 5, 3))).shape == (4, 5, 4, 4)


def test_normalize_at_the_ends_of_the_range():
    vectors = np.array([[3e200, 4e200], [3e-200, 4e-200], [0, 0]])
    assert np.allclose(tf.normalize(vectors), [[0.6, 0.8], [0.6, 0.8], [0, 0]])
