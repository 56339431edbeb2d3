"""Views against float64 formulas; cameras chosen by name, number and text."""

from __future__ import annotations

import math
from types import SimpleNamespace

import numpy as np
import pytest

from common.errors import SceneError, UserError
from common.numerics.transforms import compose, pose_looking_at, rotation, transform_points
from common.scene import Pose, SceneCamera
from common.view.camera import (
    UNIT_EV100,
    Camera,
    Orthographic,
    Perspective,
    View,
    exposure,
    framed_view,
    view_of_scene,
)
from common.view.inputs import Inputs
from common.view.positioners import FirstPerson, Fixed, MoveTo, Orbit


def a_scene(*cameras, low=(-1, -2, -3), high=(3, 2, 1), name="test"):
    bounds = np.array([low, high], float)
    scale = float(np.linalg.norm(bounds[1] - bounds[0]) / 2)
    place = {"bounds": bounds, "length_scale": scale, "ev100": None, "environment": None}
    return SimpleNamespace(name=name, cameras=list(cameras), **place)


def a_pose(*matrices):
    return Pose(0.0, np.array(matrices, float).reshape(-1, 4, 4), np.zeros((0, 4, 4)), {})


def test_exposure_is_the_photometric_formula():
    assert exposure(UNIT_EV100) == pytest.approx(1.0, rel=1e-15)
    assert exposure(15.0) == pytest.approx(1 / 39321.6) and exposure(3.0) / exposure(4.0) == 2.0


@pytest.mark.feature("camera/facade")
def test_matrices_equal_the_float64_reference():
    """The reference is written out, element by element, without any function of ours."""
    eye, target, yfov, near, aspect = np.array([3.0, 1, 4]), np.array([1.0, 5, 9]), 0.9, 0.2, 1.6
    camera = Camera(Fixed(pose_looking_at(eye, target)), Perspective(yfov, near))
    view = camera.advance(0.01, Inputs())
    z = (eye - target) / math.sqrt(4 + 16 + 25)
    x = np.array([z[2], 0, -z[0]]) / math.hypot(z[2], z[0])
    y = np.array([z[1] * x[2] - z[2] * x[1], z[2] * x[0] - z[0] * x[2], z[0] * x[1] - z[1] * x[0]])
    reference = np.eye(4)
    for row, axis in enumerate((x, y, z)):
        reference[row, :3], reference[row, 3] = axis, -(axis @ eye)
    assert np.abs(view.view_from_world() - reference).max() < 1e-14
    f = math.cos(yfov / 2) / math.sin(yfov / 2)
    projection = [[f / aspect, 0, 0, 0], [0, -f, 0, 0], [0, 0, 0, near], [0, 0, -1, 0]]
    assert np.abs(view.clip_from_view(aspect) - projection).max() < 1e-15
    assert np.abs(view.clip_from_world(aspect) - np.array(projection) @ reference).max() < 1e-14
    assert np.array_equal(view.eye, eye)


@pytest.mark.feature("camera/facade")
def test_swapping_positioners_needs_no_change_at_the_caller():
    start = pose_looking_at((0, 1, 5), (0, 1, 0))
    goal = MoveTo(np.zeros(3), np.zeros(3), np.ones(3), np.zeros(3))
    camera, inputs, cuts = Camera(Fixed(start), Perspective()), Inputs(), []
    for positioner in (None, None, FirstPerson.at(start), Orbit.at(start, 5.0), goal, None):
        if positioner is not None:
            camera.positioner = positioner
        view = camera.advance(0.02, inputs)
        cuts.append(view.cut)
        rigid = view.world_from_view[:3, :3]
        assert np.abs(rigid @ rigid.T - np.eye(3)).max() < 1e-14
        if not isinstance(camera.positioner, MoveTo):
            assert np.abs(view.world_from_view - start).max() < 1e-14  # each takes over the pose
    assert cuts == [True, False, True, True, True, False]


def test_equal_views():
    pose = pose_looking_at((1, 2, 3), (0, 0, 0))
    view = View(pose, Perspective(), 1.0)
    assert view == View(pose.copy(), Perspective(), 1.0)
    moved = pose.copy()
    moved[0, 3] = np.nextafter(moved[0, 3], 2)
    for other in (
        View(moved, Perspective(), 1.0),
        View(pose, Perspective(0.5), 1.0),
        View(pose, Perspective(), 2.0),
    ):
        assert view != other
    assert view != View(pose, Perspective(), 1.0, cut=True) and view != "view"


def test_a_pose_does_not_change_behind_the_back_of_a_renderer():
    """A renderer compares a view with that of the frame before, which it has kept."""
    pose = np.eye(4)
    view = View(pose)
    pose[0, 3] = 1.0
    assert view == View(np.eye(4))
    with pytest.raises(ValueError, match="read-only"):
        view.world_from_view[0, 3] = 1.0


@pytest.mark.parametrize("aspect", [16 / 9, 1.0, 0.4])
def test_a_framed_view_fits_the_bounding_sphere(aspect):
    scene = a_scene(low=(10, 20, 30), high=(14, 24, 34))
    view = view_of_scene(scene, a_pose(), None, aspect)
    centre, radius = np.array([12.0, 22, 32]), math.sqrt(12)
    rng = np.random.default_rng(1)
    sphere = rng.normal(size=(20_000, 3))
    sphere = centre + radius * sphere / np.linalg.norm(sphere, axis=1, keepdims=True)
    ndc = transform_points(view.clip_from_world(aspect), sphere)
    assert 0.99 < np.abs(ndc[:, :2]).max() <= 1.0 + 1e-12
    assert (ndc[:, 2] > 0).all() and (ndc[:, 2] < 1).all()
    assert view.eye[1] > centre[1] and view.eye[2] > centre[2]
    assert abs(transform_points(view.clip_from_world(aspect), centre)[:2]).max() < 1e-12


def test_framing_scales_with_the_scene():
    near = {}
    for scale in (1e-3, 1.0, 1e3):
        scene = a_scene(low=np.array([-1, -2, -3]) * scale, high=np.array([3, 2, 1]) * scale)
        view = framed_view(scene, 1.5)
        near[scale] = (view.eye / scale, view.projection.near / scale)
    for scale in (1e-3, 1e3):
        assert np.allclose(near[scale][0], near[1.0][0]) and near[scale][1] == pytest.approx(near[1.0][1])


def test_cameras_by_order_name_and_number():
    scene = a_scene(
        SceneCamera("hall", 0, yfov=0.7, near=0.3),
        SceneCamera("plan", 1, kind="orthographic", ymag=4.0, near=0.0, far=50.0, ev100=9.0),
    )
    poses = a_pose(compose((1, 2, 3), (0, 0, 0, 1), (1, 1, 1)), compose((0, 9, 0), (0, 0, 0, 1), (1, 1, 1)))
    first = view_of_scene(scene, poses, None, 1.0)
    assert first.projection == Perspective(0.7, 0.3) and np.array_equal(first.eye, (1, 2, 3))
    assert first.ev100 == 9.0  # the only exposure that the author chose
    assert first == view_of_scene(scene, poses, "hall", 1.0) == view_of_scene(scene, poses, "0", 1.0)
    plan = view_of_scene(scene, poses, "plan", 1.0)
    assert plan.projection == Orthographic(4.0, 0.0, 50.0) and plan == view_of_scene(scene, poses, "1", 2.0)
    ndc = transform_points(plan.clip_from_world(2.0), (8, 13, -50))
    assert np.allclose(ndc, (1, -1, 0), atol=1e-14)


@pytest.mark.parametrize("scale", [(1, 1, 1), (0.01, 0.01, 0.01), (-1, 1, 1), (2, -3, 5)])
def test_a_scaled_or_mirrored_camera_node_gives_a_rigid_view(scale):
    node = compose((1, 2, 3), (0, 0.6, 0, 0.8), scale)
    view = view_of_scene(a_scene(SceneCamera("c", 0)), a_pose(node), "c", 1.0)
    linear = view.world_from_view[:3, :3]
    assert np.abs(linear @ linear.T - np.eye(3)).max() < 1e-14 and np.linalg.det(linear) == pytest.approx(1)
    sign = math.copysign(1, scale[2])
    assert np.allclose(linear[:, 2], sign * rotation((0, 1, 0), 2 * math.atan2(0.6, 0.8))[:3, 2])


def test_a_flattened_camera_is_named():
    node = compose((1, 2, 3), (0, 0, 0, 1), (1, 1, 0))
    with pytest.raises(SceneError, match="camera 'c' of scene 'test' has no direction"):
        view_of_scene(a_scene(SceneCamera("c", 0)), a_pose(node), None, 1.0)


def test_a_view_as_text():
    view = view_of_scene(
        a_scene(SceneCamera("x", 0, ev100=12.0)), a_pose(np.eye(4)), "3,2,-5:0,1e0,0.5:40", 1.0
    )
    assert np.allclose(view.world_from_view, pose_looking_at((3, 2, -5), (0, 1, 0.5)))
    assert view.projection.yfov == pytest.approx(math.radians(40)) and view.ev100 == 12.0
    assert view_of_scene(a_scene(), a_pose(), "3,2,-5:0,1,0", 1.0).projection.yfov == pytest.approx(
        math.radians(50)
    )


@pytest.mark.feature("camera/facade")
@pytest.mark.parametrize(
    ("spec", "message"),
    [
        ("hal", "scene 'test' has no camera 'hal'; did you mean 'hall'?"),
        ("zzz", "scene 'test' has no camera 'zzz'; known are 'hall', 'plan'"),
        ("2", "camera 2 does not exist: scene 'test' has 2, counted from 0"),
        ("1,2,3:4,5", "wrong count of numbers"),
        ("1,2,3:4,5,6:7,8", "wrong count of numbers"),
        ("1,2,3:4,5,6:7:8", "wrong count of numbers"),
        ("1,2,x:4,5,6", "neither a name nor a view"),
        ("1,2,nan:4,5,6", "not finite"),
        ("1,2,3:4,5,6:180", "between 6e-05 and 180"),
        ("1,2,3:4,5,6:nan", "between 6e-05 and 180"),
        ("1,2,3:1,2,3", "the point where it stands"),
        ("", "has no camera ''"),
    ],
)
def test_a_wrong_camera_is_one_sentence(spec, message):
    scene = a_scene(SceneCamera("hall", 0), SceneCamera("plan", 0))
    with pytest.raises(UserError) as error:
        view_of_scene(scene, a_pose(np.eye(4)), spec, 1.0)
    assert message in str(error.value) and "\n" not in str(error.value)


def test_a_wrong_camera_is_told_all_names_of_a_scene_with_many():
    names = [f"street-{k}" for k in range(1, 25)]
    scene = a_scene(*(SceneCamera(name, 0) for name in names))
    with pytest.raises(UserError) as error:
        view_of_scene(scene, a_pose(np.eye(4)), "zzz", 1.0)
    assert all(f"'{name}'" in str(error.value) for name in names) and "..." not in str(error.value)


def test_a_scene_without_cameras_says_what_to_write():
    for spec in ("hall", "0"):
        with pytest.raises(UserError, match=r"ex,ey,ez:tx,ty,tz|has no cameras"):
            view_of_scene(a_scene(), a_pose(), spec, 1.0)


def test_the_exposure_is_the_user_s_then_the_author_s_then_that_of_the_environment():
    from common.environment import constant
    from common.view.camera import LIGHT_GREY, UNIT_EV100, exposure, framed_view
    from tests.support.scenes import quad_scene

    scene = quad_scene()
    assert framed_view(scene, 1.0).ev100 == UNIT_EV100
    scene.environment = constant((5000.0, 5000.0, 5000.0))
    ev100 = framed_view(scene, 1.0).ev100
    assert exposure(ev100) * 5000.0 == pytest.approx(LIGHT_GREY)
    scene.ev100 = 3.0
    assert framed_view(scene, 1.0).ev100 == 3.0
