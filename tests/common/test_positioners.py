"""Camera motion against closed forms and against the fine limit of the textbook's Euler steps."""

from __future__ import annotations

import math
import random

import numpy as np
import pytest

from common.numerics.transforms import pose_looking_at, rotation
from common.view.inputs import KEYS, Action, Inputs
from common.view.positioners import FirstPerson, MoveTo, Orbit, fly

START = pose_looking_at((0, 10, 10), (0, 10, 0))


def pressed(*keys):
    inputs = Inputs()
    for key in keys:
        assert inputs.key(key, True)
    return inputs


@pytest.mark.feature("camera/input-bindings")
def test_keys_set_their_flags():
    for key, action in zip("WSAD12", (*Action,)[:6], strict=True):
        assert pressed(key).actions == action == KEYS[key]
    assert [a.name for a in (*Action,)[:6]] == ["FORWARD", "BACK", "LEFT", "RIGHT", "UP", "DOWN"]
    assert pressed("SHIFT").actions == Action.FAST and pressed("SPACE").actions == Action.RESET_UP
    both = pressed("LEFT_SHIFT", "RIGHT_SHIFT", "W")
    both.key("LEFT_SHIFT", False)
    assert both.actions == Action.FAST | Action.FORWARD  # the other shift is still held
    both.release_all()
    assert not both.actions and not both.key("Q", True)


@pytest.mark.feature("camera/input-bindings")
@pytest.mark.parametrize("make", [lambda: FirstPerson.at(START), lambda: Orbit.at(START, 10.0)])
def test_the_same_script_gives_the_same_camera(make):
    def run():
        camera, inputs, rng = make(), Inputs(), random.Random(3)
        for _ in range(300):
            inputs.key(rng.choice(list(KEYS)), rng.random() < 0.5)
            inputs.dragging, inputs.mouse = rng.random() < 0.5, (rng.random(), rng.random())
            inputs.scroll += rng.choice((-1, 0, 1))
            camera.update(0.01, inputs)
        return camera.world_from_view

    assert np.array_equal(run(), run()) and not np.array_equal(run(), START)


@pytest.mark.feature("camera/first-person")
def test_scripted_keys_give_the_closed_form():
    """At 150 m/s^2 the limit of 10 m/s is reached after 1/15 s; released, the way left is speed * damping."""
    camera = FirstPerson.at(START)
    camera.update(0.05, pressed("W"))
    assert np.allclose(camera.velocity, (0, 0, -7.5)) and np.allclose(
        camera.position, (0, 10, 10 - 75 * 0.05**2)
    )
    camera.update(0.95, pressed("W"))
    assert np.allclose(camera.velocity, (0, 0, -10))
    assert np.allclose(camera.position, (0, 10, 10 - (10 / 30 + 10 * (1 - 1 / 15))))
    z = camera.position[2]
    camera.update(0.3, Inputs())
    assert np.allclose(camera.velocity, (0, 0, -10 * math.exp(-1.5)))
    assert camera.position[2] == pytest.approx(z - 2 * (1 - math.exp(-1.5)))
    for _ in range(500):
        camera.update(0.01, Inputs())
    assert camera.position[2] == pytest.approx(z - 2, abs=1e-12) and not camera.velocity.any()


@pytest.mark.feature("camera/first-person")
@pytest.mark.parametrize(
    ("keys", "expected"),
    [
        ("D", (1, 0, 0)),
        ("A", (-1, 0, 0)),
        ("1", (0, 1, 0)),
        ("2", (0, -1, 0)),
        ("S", (0, 0, 1)),
        ("AD", (0, 0, 0)),
    ],
)
def test_each_key_moves_along_its_axis(keys, expected):
    camera = FirstPerson.at(START)
    camera.update(0.01, pressed(*keys))
    assert np.allclose(camera.velocity, np.array(expected) * 1.5, atol=1e-12)
    fast = FirstPerson.at(START, unit=0.5)
    fast.update(0.01, pressed(*keys, "SHIFT"))
    assert np.allclose(fast.velocity, np.array(expected) * 1.5 * 10 * 0.5, atol=1e-12)


@pytest.mark.feature("camera/first-person")
def test_a_hundred_thousand_random_updates_stay_rigid_and_below_the_limit():
    camera, inputs, rng = FirstPerson.at(START), Inputs(), random.Random(5)
    keys = [key for key in KEYS if key != "SPACE"]  # which would wipe out what errors have gathered
    for step in range(100_000):
        if step % 8 == 0:
            inputs.key(rng.choice(keys), rng.random() < 0.4)
            inputs.dragging = rng.random() < 0.2
            inputs.mouse = (rng.random(), rng.random())
        camera.update(rng.random() * 0.05, inputs)
        limit = 100.0 if Action.FAST in inputs.actions else 10.0
        assert camera.velocity @ camera.velocity <= (limit * (1 + 1e-12)) ** 2
    linear = camera.world_from_view[:3, :3]
    assert np.abs(linear @ linear.T - np.eye(3)).max() < 1e-14
    assert np.linalg.det(linear) == pytest.approx(1, abs=1e-14)
    assert np.isfinite(camera.position).all()


@pytest.mark.feature("camera/first-person")
def test_without_input_the_speed_only_falls():
    camera = FirstPerson.at(START)
    camera.velocity = np.array([30.0, -50, 20])
    speeds = []
    for _ in range(400):
        camera.update(0.013, Inputs())
        speeds.append(np.linalg.norm(camera.velocity))
    assert (np.diff(speeds) <= 0).all() and speeds[-1] == 0.0
    still = camera.world_from_view
    camera.update(0.013, Inputs())
    assert np.array_equal(camera.world_from_view, still)  # a view at rest is bit-equal: nothing is drawn anew


@pytest.mark.feature("camera/first-person")
@pytest.mark.parametrize("seed", range(6))
def test_flight_does_not_depend_on_the_frame_rate(seed):
    rng = np.random.default_rng(seed)
    velocity, accelerate = rng.normal(size=3) * 6, rng.normal(size=3) * 80
    whole_v, whole_way = fly(velocity, accelerate, 10.0, 0.2, 0.5)
    for steps in np.split(np.sort(rng.uniform(0, 0.5, 60)), [3, 20]):
        v, way, times = velocity, np.zeros(3), [0.0, *steps, 0.5]
        for dt in np.diff(times):
            v, part = fly(v, accelerate, 10.0, 0.2, dt)
            way = way + part
        assert np.abs(v - whole_v).max() < 1e-12 and np.abs(way - whole_way).max() < 1e-12
    # The textbook's step, at 1e-5 s: v += a dt, cut to the limit, p += v dt. Its error falls with the step.
    v, way, dt = velocity * min(1, 10 / np.linalg.norm(velocity)), np.zeros(3), 1e-5
    for _ in range(50_000):
        v = v + accelerate * dt
        speed = math.sqrt(v @ v)
        if speed > 10:
            v = v * (10 / speed)
        way = way + v * dt
    assert np.abs(v - whole_v).max() < 1e-2 and np.abs(way - whole_way).max() < 1e-2


def test_flight_straight_against_the_motion_stays_finite():
    v, way = fly(np.array([10.0, 0, 0]), np.array([-150.0, 0, 0]), 10.0, 0.2, 1.0)
    assert np.allclose(v, (-10, 0, 0)) and np.allclose(way, (-10 * (1 - 2 / 15), 0, 0))


@pytest.mark.feature("camera/first-person")
def test_a_drag_turns_and_its_reverse_turns_back():
    camera, inputs = FirstPerson.at(START), Inputs(mouse=(0.9, 0.1))
    camera.update(0.01, inputs)
    inputs.dragging, inputs.mouse = True, (0.2, 0.5)
    camera.update(0.01, inputs)  # the way of the mouse before the button went down does not count
    assert np.allclose(camera.world_from_view, START, atol=1e-15)
    inputs.mouse = (0.3, 0.5)  # to the right: a tenth of the window, at 4 rad for a whole one
    camera.update(0.01, inputs)
    assert np.allclose(camera.world_from_view[:3, :3], rotation((0, 1, 0), -0.4)[:3, :3], atol=1e-14)
    inputs.mouse = (0.2, 0.5)
    camera.update(0.01, inputs)
    assert np.allclose(camera.world_from_view, START, atol=1e-14)
    inputs.mouse = (0.2, 0.6)  # down
    camera.update(0.01, inputs)
    assert camera.world_from_view[1, 2] == pytest.approx(math.sin(0.4))  # backward points up


@pytest.mark.feature("camera/first-person")
def test_space_levels_the_horizon_and_keeps_the_direction():
    tilted = START @ rotation((1, 0, 0), 0.3) @ rotation((0, 0, 1), 0.7)
    camera = FirstPerson.at(tilted)
    camera.update(0.01, pressed("SPACE"))
    level = camera.world_from_view
    assert np.allclose(level[:3, 2], tilted[:3, 2]) and abs(level[1, 0]) < 1e-15 and level[1, 1] > 0


def goal(position=(0, 0, 0), angles=(0, 0, 0), to=(0, 0, 0), to_angles=(0, 0, 0)):
    return MoveTo(*(np.array(value, float) for value in (position, angles, to, to_angles)))


@pytest.mark.feature("camera/move-to")
def test_the_goal_is_a_fixed_point():
    camera = goal((1, 2, 3), (10, 20, 30), (1, 2, 3), (10, 20, 30))
    before = camera.world_from_view
    camera.update(0.3, Inputs())
    assert np.array_equal(camera.world_from_view, before)


@pytest.mark.feature("camera/move-to")
def test_angles_turn_the_shorter_way():
    camera = goal(angles=(0, 350, 0), to_angles=(0, 10, 0))
    camera.update(math.log(2) / 5, Inputs())
    assert camera.angles_deg[1] % 360 == pytest.approx(0, abs=1e-9)  # half of +20
    camera.update(10.0, Inputs())
    assert camera.angles_deg[1] == pytest.approx(10)
    back = goal(angles=(0, 10, 0), to_angles=(0, 350, 0))
    back.update(math.log(2) / 5, Inputs())
    assert back.angles_deg[1] == pytest.approx(0, abs=1e-9)


@pytest.mark.feature("camera/move-to")
@pytest.mark.parametrize("rate", [1, 3, 7, 30, 144, 1000])
def test_the_way_shrinks_alike_at_every_frame_rate(rate):
    """To a thousandth in ln(1000) / 10 s; Euler steps overshoot below 10 frames a second, diverge below 5."""
    camera, time = goal(to=(8, 0, 0), to_angles=(0, 90, 0)), math.log(1000) / 10
    frames = max(1, round(time * rate))
    for _ in range(frames):
        camera.update(time / frames, Inputs())
    assert 8 - camera.position[0] == pytest.approx(8e-3, rel=1e-9)
    assert 90 - camera.angles_deg[1] == pytest.approx(90 * math.sqrt(1e-3), rel=1e-9)


@pytest.mark.feature("camera/move-to", "camera/first-person")
def test_the_textbooks_steps_would_depend_on_the_frame_rate():
    """Three steps of Euler, x += dx/dt dt, end elsewhere: what both flights are held to would notice them."""
    camera, velocity = goal(to=(8, 0, 0)), np.array([10.0, 0, 0])
    for _ in range(3):
        camera.update(0.05, Inputs())
        velocity, _ = fly(velocity, np.zeros(3), 10.0, 0.2, 0.1)
    assert abs((8 - camera.position[0]) - 8 * (1 - 10 * 0.05) ** 3) > 0.7
    assert abs(velocity[0] - 10 * (1 - 0.1 / 0.2) ** 3) > 0.9


def test_orbit_keeps_its_distance_and_its_target_in_the_middle():
    pose = pose_looking_at((3, 4, 5), (1, 1, 1))
    distance = math.sqrt(4 + 9 + 16)
    orbit = Orbit.at(pose, distance)
    assert np.allclose(orbit.world_from_view, pose, atol=1e-14)
    inputs = Inputs(dragging=True)
    orbit.update(0.01, inputs)
    for mouse in ((0.6, 0.4), (0.1, 0.9), (0.5, 40.0)):
        inputs.mouse = mouse
        orbit.update(0.01, inputs)
        now = orbit.world_from_view
        assert np.allclose(now[:3, 3] - now[:3, 2] * distance, (1, 1, 1))
        assert now[1, 1] > 0  # never upside down
    inputs.scroll = 10.0
    orbit.update(0.01, inputs)
    assert orbit.distance == pytest.approx(distance / math.e) and inputs.scroll == 0.0


@pytest.mark.parametrize("steps", [1, 7, 100])
def test_orbit_zooms_alike_at_every_frame_rate(steps):
    orbit = Orbit.at(START, 8.0)
    for _ in range(steps):
        orbit.update(0.5 / steps, pressed("W"))
    assert orbit.distance == pytest.approx(8 * math.exp(-0.5))


def test_orbit_goes_back_as_it_came():
    orbit = Orbit.at(START, 8.0)
    orbit.update(0.5, pressed("S"))
    assert orbit.distance == pytest.approx(8 * math.exp(0.5))
    orbit.update(0.5, pressed("W"))
    assert orbit.distance == pytest.approx(8)


@pytest.mark.parametrize("target", [(0, 1, 0), (0, -1, 0), (0, 1, -1e-9)])
def test_orbit_starts_from_straight_up_and_down_without_a_jump(target):
    pose = pose_looking_at((0, 0, 0), target)
    assert np.abs(Orbit.at(pose, 2.0).world_from_view - pose).max() < 1e-6
