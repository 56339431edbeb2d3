"""Cloth on what moves: friction and the loss of normal speed are those against the collider's own surface.

Closed forms are asked of the twin in numpy, then the kernels are held to it, and at last the frames that find out how
fast a node goes.
"""

from __future__ import annotations

import math
from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from chapters.ch05.benches.twin import Twin
from chapters.ch05.cloth.build import build_cloth
from chapters.ch05.cloth.dispatches import Moment, dispatches, frame_arrays, states_of
from chapters.ch05.cloth.layout import COLLIDER, pack
from chapters.ch05.cloth.scene import FASTEST, cloth_scene
from chapters.ch05.cloth.types import Cloth, Collider, Forces, State, Steps
from chapters.ch05.pipelines.vulkan import CHAPTER
from chapters.ch05.settings import Settings
from common.numerics.transforms import translation
from tests.support import cloths
from tests.support.cloth_runs import VIEW, state
from tests.support.cloth_scenes import cloth, cloth_scene_of

EULER = Steps(method="springs", integrator="euler", substeps=8)
VERLET = Steps(method="springs", integrator="verlet", substeps=8)
XPBD = Steps(method="xpbd", substeps=8)
OTHERS = [pytest.param("thread", marks=pytest.mark.long), "dispatch"]
every_method = pytest.mark.parametrize("steps", [XPBD, EULER, VERLET], ids=["xpbd", "euler", "verlet"])

VACUUM = Forces(air_density=0.0)
G = 9.81
SOFT = {"stretch_n_per_m": 2, "shear_n_per_m": 2, "bend_n_per_m": 1}


def level(edge: float = 0.1, **properties) -> Cloth:
    """Return a free sheet of 3 x 3 particles that lies level around x = z = 0, on y = 0."""
    fields = {**SOFT, "damping_per_s": 0.0, "thickness_m": 0.0, "drag": 0.0, "pins": [], **properties}
    sheet = cloths.sheet(build_cloth, 3, 3, edge, **fields)
    return replace(sheet, positions=sheet.positions[:, [0, 2, 1]] + (-edge, 0.0, edge))


def plane(at=(0.0, 0.0, 0.0), **motion) -> Collider:
    return Collider("plane", translation(at), **motion)


def carried(cloth: Cloth, steps: Steps, count: int, collider_at) -> list[State]:
    """Return the state after each of `count` steps, in which `collider_at(seconds)` is what is in the way."""
    twin = Twin(cloth, steps, VACUUM)
    found = []
    for step in range(1, count + 1):
        twin.meet([collider_at(step * steps.dt)])
        state = twin.advance()
        found.append(State(state.positions.copy(), state.velocities.copy()))
    return found


# --- closed forms -----------------------------------------------------------------------------------------------------


@every_method
def test_a_plane_that_moves_sideways_takes_a_sheet_along_as_friction_allows(steps):
    mu, speed = 0.3, 0.6
    found = carried(
        level(friction=mu), steps, 24, lambda t: plane((speed * t, 0, 0), velocity=(speed, 0.0, 0.0))
    )
    at = steps.dt * np.arange(1, 25)
    wanted = np.minimum(mu * G * at, speed)  # it has the plane's speed after 0.2 s
    speeds = np.array([one.velocities for one in found])
    assert np.allclose(speeds[..., 0], wanted[:, None], atol=0.01 * speed)
    assert np.abs(speeds[..., 1:]).max() < 1e-9
    gone = found[-1].positions[:, 0] - level().positions[:, 0]
    slipping = speed / (mu * G)
    assert np.allclose(gone, speed * (24 * steps.dt - slipping / 2), rtol=0.03)


@every_method
def test_without_friction_a_plane_slips_away_underneath(steps):
    found = carried(level(friction=0.0), steps, 6, lambda t: plane((t, 0, 0), velocity=(1.0, 0.0, 0.0)))
    assert np.array_equal(found[-1].positions[:, [0, 2]], level().positions[:, [0, 2]])
    assert not found[-1].velocities[:, [0, 2]].any()


@every_method
def test_a_plane_that_rises_gives_its_speed_and_lets_go_when_it_sinks_faster_than_things_fall(steps):
    found = carried(level(), steps, 12, lambda t: plane((0, 0.8 * t, 0), velocity=(0.0, 0.8, 0.0)))
    assert np.allclose(found[-1].positions[:, 1], 0.8 * 12 * steps.dt, atol=1e-3), (
        "it neither sinks in nor hovers"
    )
    assert np.allclose(found[-1].velocities[:, 1], 0.8, atol=0.06)
    sinking = carried(level(), steps, 6, lambda t: plane((0, -5.0 * t, 0), velocity=(0.0, -5.0, 0.0)))
    assert np.allclose(sinking[-1].velocities[:, 1], -G * 6 * steps.dt, rtol=1e-6)


@every_method
def test_a_turntable_holds_what_friction_can_hold(steps):
    """omega^2 r < mu g everywhere: the sheet goes round with it and keeps its place on it."""
    omega = 2.0
    sheet = level(friction=0.5)
    assert omega**2 * 0.15 < 0.5 * G
    twin = Twin(sheet, steps, VACUUM)
    twin.state.velocities[:] = np.cross((0.0, omega, 0.0), sheet.positions)
    twin.meet([plane(spin=(0.0, omega, 0.0))])
    x = twin.advance(30).positions
    turn = omega * 30 * steps.dt
    c, s = math.cos(turn), math.sin(turn)
    wanted = sheet.positions @ np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]]).T
    assert np.allclose(x, wanted, atol=5e-4)
    assert np.allclose(twin.state.velocities, np.cross((0.0, omega, 0.0), wanted), atol=0.01)


TURNING = {
    "sphere": Collider("sphere", translation((0.0, -2.0, 0.0)), 2.0, spin=(0.0, 0.0, -3.0)),
    "box": Collider("box", translation((0.0, -0.5, -1.0)), half=(2.0, 0.5, 2.0), spin=(0.0, 3.0, 0.0)),
}
"""Both go towards +x where the sheet lies: a ball that rolls beneath it, and a box that turns like a table."""


@every_method
@pytest.mark.parametrize("shape", TURNING)
def test_a_ball_and_a_box_that_turn_take_along_what_lies_on_them(steps, shape):
    mu = 0.4
    sheet = level(0.02, friction=mu, kg_per_m2=20)
    v = carried(sheet, steps, 3, lambda _: TURNING[shape])[-1].velocities
    assert v[:, 0].mean() == pytest.approx(mu * G * 3 * steps.dt, rel=0.05)
    assert abs(v[:, 2].mean()) < 0.01


@every_method
def test_what_is_at_rest_is_as_what_has_no_speed_to_the_bit(steps):
    at = translation((0.03, -0.02, 0.01))
    named = [Collider("sphere", at, 0.05), Collider("box", at, half=(0.2, 0.03, 0.3)), Collider("plane", at)]
    sheet = level(thickness_m=0.01)
    states = []
    for moving in (False, True):
        twin = Twin(sheet, steps, VACUUM, dtype=np.float32)
        twin.state.velocities[:] = np.random.default_rng(3).normal(size=(9, 3))
        zero = (0.0, 0.0, 0.0)
        twin.meet([replace(one, velocity=zero, spin=zero) if moving else one for one in named])
        state = twin.advance(8)
        states.append(state.positions.tobytes() + state.velocities.tobytes())
    assert states[0] == states[1]


# --- the kernels ------------------------------------------------------------------------------------------------------

WEAK = {"stretch_n_per_m": 5, "shear_n_per_m": 3, "bend_n_per_m": 1}


def moving_things() -> list[Collider]:
    ball, box, ground = (translation(at) for at in ((0.2, -0.35, 0.12), (0.0, -0.45, 0.1), (0.0, -0.5, 0.0)))
    box[:3, :3] = np.array([[0.8, 0.0, 0.6], [0.0, 1.0, 0.0], [-0.6, 0.0, 0.8]])
    return [
        Collider("sphere", ball, 0.1, velocity=(0.5, 0.25, -1.0), spin=(1.0, 8.0, 0.5)),
        Collider("box", box, half=(0.08, 0.1, 0.06), velocity=(0.1, 0.7, 0.3), spin=(0.0, 0.0, 4.0)),
        Collider("plane", ground, velocity=(1.0, 0.2, 0.0), spin=(0.0, 2.0, 0.1)),
    ]


def simulated(device, made, steps, count, execution, colliders, begin):
    packed = pack([made], colliders=len(colliders))
    arrays = frame_arrays(packed, steps, WIND, Moment.still(1, count), colliders)
    for name in ("positions", "velocities"):
        arrays[name] = getattr(begin, name).astype(np.float32)
    todo = dispatches(packed, steps, count, execution)
    found = cloths.run(CHAPTER, device, packed, todo, arrays)
    return states_of(packed, found["positions"], found["velocities"])[0]


WIND = Forces(wind=(1.0, 0.5, 4.0))


def whole(state: State) -> bytes:
    return state.positions.tobytes() + state.velocities.tobytes()


@pytest.mark.variants("vulkan", "gl")
@every_method
@pytest.mark.parametrize("other", OTHERS)
def test_every_execution_meets_what_moves_with_the_same_bits_and_as_the_twin(chapter, steps, other):
    steps = replace(steps, substeps=3)
    made = cloths.sheet(build_cloth, 6, 5, pins=[0], **WEAK)
    begin = Twin(made, XPBD, WIND, dtype=np.float32).advance(12)
    run = partial(simulated, chapter.device, made, steps, 2, begin=begin)
    found = run("group", moving_things())
    assert whole(found) == whole(run(other, moving_things()))
    still = run("group", [replace(one, velocity=(0, 0, 0), spin=(0, 0, 0)) for one in moving_things()])
    assert np.abs(still.velocities - found.velocities).max() > 0.05, "or nothing is touched"
    twin = Twin(made, steps, WIND, moving_things(), np.float32)
    twin.state = begin
    assert np.abs(twin.advance(2).positions - found.positions).max() < 1e-5


@pytest.mark.variants("gl")
@pytest.mark.parametrize("steps", [XPBD, VERLET], ids=["xpbd", "springs"])
def test_vulkan_and_opengl_meet_what_moves_with_the_same_bits(vulkan_device, gl_context, steps):
    if not (vulkan_device.capabilities.is_software and gl_context.capabilities.is_software):
        pytest.skip("two compilers, of which each divides and takes roots in its way")
    made = cloths.sheet(build_cloth, 5, 6, pins=[0], **WEAK)
    begin = Twin(made, XPBD, WIND, dtype=np.float32).advance(12)
    states = [
        simulated(device, made, steps, 4, "group", moving_things(), begin)
        for device in (vulkan_device, gl_context)
    ]
    assert whole(states[0]) == whole(states[1])


# --- from frame to frame ----------------------------------------------------------------------------------------------


def turned(angle: float, at=(0.0, 0.0, 0.0)) -> np.ndarray:
    """Return the matrix of a node at a place, turned about y, and stretched."""
    c, s = math.cos(angle), math.sin(angle)
    world = translation(at)
    world[:3, :3] = np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]]) * 2.0
    return world


@pytest.mark.parametrize("shape", ["sphere", "plane", "box"])
def test_speed_and_spin_follow_from_where_a_node_was(shape):
    scene = cloth_scene_of(cloth(), cloth(), colliders=[({"shape": "sphere", "radius_m": 1}, np.eye(4))])
    obstacle = replace(cloth_scene(scene).obstacles[0], shape=shape, half=(0.1, 0.1, 0.1))
    before, now = turned(0.3, (1, 0, 0)), turned(0.35, (1.01, 0, 0.02))
    found = obstacle.moved(before, now, 0.05)
    assert np.allclose(found.velocity, (0.2, 0, 0.4)) and np.allclose(found.spin, (0, 1.0, 0))
    assert np.array_equal(found.world_from_collider, obstacle.at(now).world_from_collider)
    still = obstacle.moved(now, now.copy(), 0.05)
    assert still.velocity == still.spin == (0.0, 0.0, 0.0)
    slid = obstacle.moved(turned(0.3), turned(0.3, (0.01, 0, 0)), 0.05)
    assert slid.spin == (0.0, 0.0, 0.0) and np.allclose(slid.velocity, (0.2, 0, 0))


def test_what_is_put_elsewhere_has_no_speed():
    """An edit moves a node from here to there at once: it would hit the cloth like a shot."""
    scene = cloth_scene_of(cloth(), colliders=[({"shape": "sphere", "radius_m": 1}, np.eye(4))])
    obstacle = cloth_scene(scene).obstacles[0]
    far = obstacle.moved(np.eye(4), translation((FASTEST * 1.01, 0, 0)), 1.0)
    assert far.velocity == (0.0, 0.0, 0.0)
    flipped = obstacle.moved(turned(0.0), turned(3.0), 1 / 60)
    assert flipped.velocity == flipped.spin == (0.0, 0.0, 0.0)
    assert obstacle.moved(np.eye(4), translation((1, 0, 0)), 0.0).velocity == (0.0, 0.0, 0.0), (
        "no step was made"
    )


@pytest.mark.variants("vulkan", "gl")
def test_a_renderer_finds_out_how_fast_a_collider_goes(chapter):
    """A plane under a sheet that lies on it goes sideways at 0.5 m/s, and takes it along by mu g until it has that."""
    lying = np.array([[1, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0.0051], [0, 0, 0, 1.0]])
    piece = cloth(3, 3, [], friction=0.3, damping_per_s=0, drag=0)
    scene = cloth_scene_of(piece, matrices=[lying], colliders=[({"shape": "plane"}, np.eye(4))], size=(3, 3))
    settings = replace(Settings(), graph="forward", cloth_substeps=4)
    with chapter.open(scene, (16, 16), settings) as renderer:
        renderer.render(VIEW, 0.0)
        for number in range(1, 16):
            with scene.edit() as edit:
                edit.set_transform(1, matrix=translation((0.5 * number / 60, 0.0, 0.0)))
            renderer.render(VIEW, number / 60)
            if number == 6:
                slipping = state(renderer, "velocities")[:, 0].mean()
        speeds = state(renderer, "velocities")
    assert slipping == pytest.approx(0.3 * G * 0.1, rel=0.05)
    assert np.allclose(speeds[:, 0], 0.5, atol=0.01)


def test_a_record_of_a_collider_has_its_motion_about_each_cloth():
    made = replace(level(), anchor=np.array((1.0, 2.0, 3.0)))
    arrays = frame_arrays(pack([made], colliders=3), XPBD, VACUUM, Moment.still(1, 2), moving_things())
    rows = arrays["colliders"].view(COLLIDER)
    assert np.array_equal(rows["velocity"][0], np.float32((0.5, 0.25, -1.0, 1)))
    assert np.array_equal(rows["spin"][2], np.float32((0.0, 2.0, 0.1, 0)))
