"""Camera paths against closed forms: speeds on the screen and in the world, key poses, and what is refused."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest

from common.errors import UserError
from common.numerics.transforms import pose_looking_at, rotation
from common.view.camera import Orthographic, Perspective, View
from common.view.key_poses import read_keys
from common.view.paths import KINDS, STEPS_PER_S, TURN_PERIOD_S, Stage, parse_path, path

CENTRE = np.array([0.5, 1.0, -0.5])
EYE, TARGET = np.array([3.0, 2.5, 5.0]), np.array([0.25, 1.0, 0.0])
SIZE = (640, 360)


def stage(scale: float = 1.0, shift=(0.0, 0.0, 0.0), **changes) -> Stage:
    """A scene of length 4 seen from its corner, scaled and then shifted."""
    pose = pose_looking_at(EYE, TARGET)
    pose[:3, 3] = EYE * scale + shift
    start = View(pose, changes.get("projection", Perspective(math.radians(50), 0.01 * scale)), 3.0)
    return Stage(start, CENTRE * scale + np.array(shift), 4.0 * scale, SIZE)


def pixel(view: View, point: np.ndarray) -> np.ndarray:
    """The place (2,) of a point in the picture, in pixels from its upper left corner."""
    clip = view.clip_from_world(SIZE[0] / SIZE[1]) @ np.append(point, 1.0)
    return (clip[:2] / clip[3] + 1) / 2 * SIZE


@pytest.mark.parametrize("name", KINDS)
def test_a_path_begins_at_the_start_stays_rigid_and_grows_at_its_end(name):
    seen = stage()
    views = path(name, seen, 90)
    assert len(views) == 90
    np.testing.assert_allclose(views[0].world_from_view, seen.start.world_from_view, atol=1e-15)
    for view in views:
        turn = view.world_from_view[:3, :3]
        np.testing.assert_allclose(turn @ turn.T, np.eye(3), atol=1e-14)
        assert np.linalg.det(turn) == pytest.approx(1.0) and (view.world_from_view[3] == (0, 0, 0, 1)).all()
        assert (view.projection, view.ev100) == (seen.start.projection, 3.0)
    assert path(name, seen, 30) == views[:30] == path(name, seen, 90)[:30]
    # All but a pan know time alone: twice the rate has the same views in every second frame.
    if name != "pan":
        for view, other in zip(views, path(name, seen, 180, 120.0)[::2], strict=True):
            np.testing.assert_allclose(view.world_from_view, other.world_from_view, atol=1e-14)


@pytest.mark.parametrize("name", KINDS)
@pytest.mark.parametrize("scale", [1e-3, 1e3])
def test_a_scene_of_another_size_is_passed_in_the_same_time(name, scale):
    for view, other in zip(path(name, stage(), 60), path(name, stage(scale), 60), strict=True):
        np.testing.assert_allclose(other.eye, view.eye * scale, rtol=1e-12)
        np.testing.assert_allclose(
            other.world_from_view[:3, :3], view.world_from_view[:3, :3], rtol=0, atol=1e-13
        )


@pytest.mark.parametrize("name", KINDS)
def test_far_from_the_origin_a_path_keeps_its_digits(name):
    shift = np.array((1e6, -2e6, 3e6))
    for view, other in zip(path(name, stage(), 60), path(name, stage(1.0, shift), 60), strict=True):
        np.testing.assert_allclose(other.eye - shift, view.eye, rtol=0, atol=4 * np.spacing(3e6))


@pytest.mark.parametrize("projection", [Perspective(math.radians(50), 0.01), Orthographic(2.0, 0.01, 100.0)])
@pytest.mark.parametrize("pixels", [2.0, -0.75])
def test_a_pan_moves_points_at_its_depth_by_whole_and_broken_pixels(projection, pixels):
    seen = stage(projection=projection)
    pose = seen.start.world_from_view
    views = path(f"pan:pixels={pixels},depth=0.75", seen, 40)
    for right, up in ((0.0, 0.0), (1.2, -0.7)):
        point = EYE + pose[:3, :3] @ np.array((right, up, -3.0))  # 0.75 length scales of 4 m ahead
        places = np.array([pixel(view, point) for view in views])
        expected = places[0] - np.outer(np.arange(40), (pixels, 0.0))
        np.testing.assert_allclose(places, expected, rtol=0, atol=1e-9)
    # Twice as far ahead it is half as fast in perspective.
    point = EYE - 6.0 * pose[:3, 2]
    speed = (pixel(views[0], point) - pixel(views[1], point))[0]
    half = 1.0 if isinstance(projection, Orthographic) else 0.5
    assert speed == pytest.approx(half * pixels, abs=1e-9)


def test_a_pan_without_a_depth_is_at_that_of_the_centre_of_the_scene():
    seen = stage()
    views = path("pan:pixels=3", seen, 2)
    assert (pixel(views[0], CENTRE) - pixel(views[1], CENTRE))[0] == pytest.approx(3.0, abs=1e-9)
    behind = Stage(seen.start, EYE + seen.start.world_from_view[:3, 2], seen.length, SIZE)
    assert behind.depth_of_centre() == seen.length


def test_a_dolly_goes_along_the_line_of_sight():
    seen = stage()
    views = path("dolly:speed=0.5", seen, 61)
    way = views[60].eye - EYE
    np.testing.assert_allclose(way, -seen.start.world_from_view[:3, 2] * 0.5 * 4.0, atol=1e-14)
    back = path("dolly:speed=-0.5", seen, 61)[60].eye - EYE
    np.testing.assert_allclose(back, -way, atol=1e-14)


def test_an_orbit_keeps_its_distance_and_closes():
    seen = stage()
    views = path("orbit:degrees=90", seen, 241)
    for view in views:
        assert np.linalg.norm(view.eye - CENTRE) == pytest.approx(np.linalg.norm(EYE - CENTRE), rel=1e-14)
        assert view.eye[1] == pytest.approx(EYE[1], rel=1e-14)
        np.testing.assert_allclose(pixel(view, CENTRE), pixel(views[0], CENTRE), atol=1e-9)
    np.testing.assert_allclose(views[240].world_from_view, views[0].world_from_view, atol=1e-13)
    quarter = rotation((0, 1, 0), math.pi / 2)[:3, :3]
    np.testing.assert_allclose(views[60].eye, CENTRE + quarter @ (EYE - CENTRE), atol=1e-13)


def test_a_walk_goes_ahead_on_a_level_and_its_head_comes_back():
    seen = stage()
    whole = (
        math.lcm(round(10 * TURN_PERIOD_S), 100) / 10
    )  # whole periods of the head and of pairs of steps, 20 s
    assert (whole * STEPS_PER_S / 2).is_integer() and (whole / TURN_PERIOD_S).is_integer()
    views = path("walk:speed=0.1", seen, round(whole * 30) + 1, 30.0)
    ahead = -seen.start.world_from_view[:3, 2] * (1, 0, 1)
    ahead /= np.linalg.norm(ahead)
    np.testing.assert_allclose(views[-1].eye - EYE, ahead * 0.1 * 4.0 * whole, atol=1e-12)
    np.testing.assert_allclose(
        views[-1].world_from_view[:3, :3], views[0].world_from_view[:3, :3], atol=1e-13
    )
    heights = np.array([view.eye[1] for view in views]) - EYE[1]
    step = 0.1 * 4.0 / STEPS_PER_S
    assert heights.max() == pytest.approx(0.04 * step, rel=0.02) and heights.min() == pytest.approx(
        -0.04 * step, rel=0.02
    )
    turns = [math.degrees(math.acos(min(1.0, -view.world_from_view[:3, 2] @ ahead))) for view in views]
    assert max(turns) > 6.0
    straight = path("walk:speed=0.1,bob=0,turn=0", seen, 31, 30.0)
    np.testing.assert_allclose(straight[30].eye - EYE, ahead * 0.4, atol=1e-14)


@pytest.mark.parametrize("direction", [(0, -1, 0), (0, 1, 0)])
def test_a_walk_that_looks_straight_down_or_up_still_goes_on_a_level(direction):
    pose = pose_looking_at((0, 5, 0), np.array((0, 5, 0)) + direction)
    seen = Stage(View(pose), np.zeros(3), 1.0, SIZE)
    way = path("walk:speed=1,bob=0", seen, 61)[60].eye - (0, 5, 0)
    assert way[1] == 0.0 and np.linalg.norm(way) == pytest.approx(1.0)


# --- key poses --------------------------------------------------------------------------------------------------------


def written(tmp_path, *keys) -> str:
    file = tmp_path / "keys.json"
    file.write_text(
        json.dumps({"keys": [{"time": time, "eye": eye, "target": target} for time, eye, target in keys]})
    )
    return str(file)


def test_key_poses_are_met_and_held_before_and_after(tmp_path):
    keys = (
        (0.5, [0, 1, 5], [0, 0, 0]),
        (1.0, [2, 1, 5], [0, 1, 0]),
        (2.25, [3, 2, 1], [0, 0, 0]),
        (3.0, [3, 2, -4], [9, 0, 0]),
    )
    way = parse_path(written(tmp_path, *keys))
    seen = stage()
    for time, eye, target in keys:
        np.testing.assert_allclose(
            way.view(seen, round(time * 4), 4.0).world_from_view, pose_looking_at(eye, target), atol=1e-14
        )
    for frame, (_, eye, target) in ((0, keys[0]), (400, keys[-1])):
        view = way.view(seen, frame, 4.0)
        np.testing.assert_allclose(view.world_from_view, pose_looking_at(eye, target), atol=1e-14)
        assert (view.projection, view.ev100) == (seen.start.projection, 3.0)
    assert way.frames(60.0) == 181 and way.frames(4.0) == 13
    assert way.frames(1e300) == 10**15 + 1
    assert parse_path("walk").frames(60.0) is None


def test_between_key_poses_a_parabola_is_a_parabola(tmp_path):
    """Slopes of Catmull and Rom are exact for polynomials of degree 2 at even times, and so is the cubic."""

    def at(time: float) -> list[float]:
        return [time, 3 * time * time - time, -2.0 * time * time]

    keys = [(float(time), at(time), [100.0, 0.0, 0.0]) for time in range(6)]
    poses = read_keys(written(tmp_path, *keys))
    for time in np.linspace(1.0, 4.0, 37):  # the first and the last piece have a slope of one side
        np.testing.assert_allclose(poses.pose(time)[:3, 3], at(time), rtol=0, atol=1e-12)
    near = 1e-6
    for key in (1.0, 3.0):  # no jump of the velocity at a key
        before, at_key, after = (poses.pose(key + step)[:3, 3] for step in (-near, 0.0, near))
        np.testing.assert_allclose((at_key - before) / near, (after - at_key) / near, atol=1e-3)


def test_between_key_poses_the_camera_turns_at_a_constant_rate(tmp_path):
    def towards(degrees: float) -> list[float]:
        return [math.sin(math.radians(degrees)), 0.0, -math.cos(math.radians(degrees))]

    poses = read_keys(written(tmp_path, (0, [0, 0, 0], towards(0)), (2, [0, 0, 0], towards(80))))
    for time in (0.0, 0.3, 1.0, 1.7, 2.0):
        np.testing.assert_allclose(-poses.pose(time)[:3, 2], towards(40 * time), atol=1e-14)


def test_one_key_pose_stands_still(tmp_path):
    way = parse_path(written(tmp_path, (3, [1, 2, 3], [0, 0, 0])))
    views = [way.view(stage(), frame, 1.0) for frame in (0, 3, 9)]
    assert views[0] == views[1] == views[2]


# --- what is refused --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("wlak", "There is no path 'wlak'; did you mean 'walk'?"),
        (
            "",
            "There is no path ''; known are 'dolly', 'orbit', 'pan', 'still', 'walk', or the name of a .json file",
        ),
        ("still:a=1", "The path still has no value 'a'; it has none."),
        ("walk:sped=1", "The path walk has no value 'sped'; did you mean 'speed'?"),
        ("walk:speed", "The path walk cannot have 'speed': speed is a number from -100 to 100"),
        ("walk:speed=fast", "cannot have 'speed=fast'"),
        ("walk:speed=nan", "cannot have 'speed=nan'"),
        ("walk:turn=181", "turn is a number from 0 to 180, degrees that the head turns"),
        ("pan:pixels=1e9", "pixels is a number from -10000 to 10000"),
        ("nowhere.json", "There is no file nowhere.json with the key poses of a path."),
        ("nowhere/walk", "There is no file nowhere/walk with"),
        ("a\0.json", "a\\x00.json cannot be read"),
    ],
)
def test_a_wrong_text_is_a_sentence(text, says):
    with pytest.raises(UserError) as caught:
        parse_path(text)
    assert says in str(caught.value) and "\n" not in str(caught.value)
    assert str(caught.value)[-1] in ".?"


KEY = '{"time": 0, "eye": [1, 2, 3], "target": [0, 0, 0]}'


@pytest.mark.parametrize(
    ("content", "says"),
    [
        ("{", ":1:2 is no JSON"),
        ('{"keys": [\n  1, }', ":2:6 is no JSON"),
        ("[]", "has no key poses: write"),
        ("{}", "has no key poses"),
        ('{"keys": []}', "has no key poses"),
        ('{"keys": {"time": 0}}', "has no key poses"),
        ('{"keys": [3]}', "keys[0] is 3: a key pose is an object"),
        ('{"keys": [{"time": 0, "eye": [1, 2, 3]}]}', "keys[0] lacks target"),
        ('{"keys": [{"tme": 0}]}', "keys[0] has a field 'tme'; did you mean 'time'?"),
        (f'{{"keys": [{KEY}, {KEY}]}}', "keys[1].time is 0, but the key before is at 0: each key is later"),
        (
            f'{{"keys": [{KEY.replace("0,", "2,", 1)}, {KEY.replace("0,", "1.5,", 1)}]}}',
            "keys[1].time is 1.5",
        ),
        (
            '{"keys": [{"time": -1, "eye": [1, 2, 3], "target": [0, 0, 0]}]}',
            "keys[0].time is -1: give seconds",
        ),
        ('{"keys": [{"time": true, "eye": [1, 2, 3], "target": [0, 0, 0]}]}', "keys[0].time is true"),
        ('{"keys": [{"time": 1e999, "eye": [1, 2, 3], "target": [0, 0, 0]}]}', "keys[0].time is Infinity"),
        (
            '{"keys": [{"time": 0, "eye": [1, 2], "target": [0, 0, 0]}]}',
            "keys[0].eye is [1, 2]: give x, y and z",
        ),
        ('{"keys": [{"time": 0, "eye": [1, 2, "3"], "target": [0, 0, 0]}]}', 'keys[0].eye is [1, 2, "3"]'),
        ('{"keys": [{"time": 0, "eye": [1, 2, 1e99], "target": [0, 0, 0]}]}', "keys[0].eye is [1, 2, 1e+99]"),
        ('{"keys": [{"time": 0, "eye": [1, 2, NaN], "target": [0, 0, 0]}]}', "NaN is no number in JSON"),
        (
            '{"keys": [{"time": 0, "eye": [1, 2, 3], "target": [1, 2, 3]}]}',
            "keys[0] looks at the point where it",
        ),
        ("[" * 100_000, "is no JSON"),
        (b"\xff\xfe", "is no text in UTF-8: byte 0"),
        (b"[" + b" " * (4 << 20), "has more than 4 MiB"),
    ],
)
def test_a_file_that_is_no_path_is_a_sentence_with_its_place(tmp_path, content, says):
    file = tmp_path / "path.json"
    file.write_bytes(content if isinstance(content, bytes) else content.encode())
    with pytest.raises(UserError) as caught:
        parse_path(str(file))
    text = str(caught.value)
    assert text.startswith(str(file)) and says in text and "\n" not in text and text[-1] in ".?"


def test_a_folder_is_no_file_of_key_poses(tmp_path):
    with pytest.raises(UserError, match=r"is a folder|cannot be read"):
        parse_path(f"{tmp_path}/")
