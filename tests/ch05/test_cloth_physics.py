"""What cloth does, held to physics: closed forms, conservation laws, and loops over particles.

All of it is asked of the twin in numpy; test_cloth_kernels.py holds the GPU to the twin.
"""

from __future__ import annotations

import math
from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from chapters.ch05.benches import measures as measures
from chapters.ch05.benches.twin import Twin, depth_below
from chapters.ch05.cloth.build import build_cloth
from chapters.ch05.cloth.model import model_of
from chapters.ch05.cloth.steps import fit_steps, greatest_omega
from chapters.ch05.cloth.types import Cloth, Collider, Forces, State, Steps
from tests.support import cloths

sheet = partial(cloths.sheet, build_cloth)

EULER = Steps(substeps=8, method="springs", integrator="euler")
VERLET = Steps(substeps=8, method="springs", integrator="verlet")
XPBD = Steps(substeps=8, method="xpbd")
NOTHING = Forces(gravity=(0.0, 0.0, 0.0), air_density=0.0)
VACUUM = Forces(air_density=0.0)
SOFT = {"stretch_n_per_m": 2, "shear_n_per_m": 2, "bend_n_per_m": 1}
"""So few newtons a metre that any step is short enough."""

every_method = pytest.mark.parametrize("steps", [XPBD, EULER, VERLET], ids=["xpbd", "euler", "verlet"])


def two_particles(
    stiffness: float = 50.0, masses: tuple[float, float] = (0.1, 0.1), rest: float = 1.0
) -> Cloth:
    """Return two particles side by side with one spring, without damping and air."""
    return Cloth(
        mesh=0,
        node=0,
        anchor=np.zeros(3),
        positions=np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]]),
        masses=np.array(masses),
        springs=np.array([[0, 1]], np.int32),
        kinds=np.zeros(1, np.uint8),
        rest=np.array([rest]),
        stiffness=np.array([stiffness, 1.0, 1.0]),
        triangles=np.zeros((0, 3), np.int32),
        particle_of=np.arange(2, dtype=np.int32),
        damping=0.0,
    )


# --- one spring -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("integrator", ["euler", "verlet"])
def test_two_particles_swing_as_the_closed_form_says(integrator):
    cloth = two_particles(rest=0.9)
    omega = math.sqrt(2 * 50.0 / 0.1)
    assert greatest_omega(cloth) == pytest.approx(omega)
    dt = 0.02 / omega
    steps = Steps(dt, 1, 1, "springs", integrator)
    twin = Twin(cloth, steps, NOTHING)
    errors = []
    for step in range(1, 400):
        x = twin.advance().positions
        errors.append(abs(x[1, 0] - x[0, 0] - (0.9 + 0.1 * math.cos(omega * step * dt))) / 0.1)
    # Euler's positions lag by half a step, Verlet's phase runs ahead by (h omega)^2 / 24.
    assert max(errors) < (0.011 if integrator == "euler" else 2e-4)


def test_verlet_is_of_second_order():
    cloth = two_particles(rest=0.9)
    omega = math.sqrt(2 * 50.0 / 0.1)
    errors = []
    for count in (50, 100):
        steps = Steps(4.0 / omega / count, 1, 1, "springs", "verlet")
        x = Twin(cloth, steps, NOTHING).advance(count).positions
        errors.append(abs(x[1, 0] - x[0, 0] - (0.9 + 0.1 * math.cos(4.0))))
    assert errors[0] / errors[1] == pytest.approx(4.0, rel=0.05)


def test_springs_are_stable_up_to_the_bound_and_not_beyond():
    cloth = two_particles(rest=0.9)
    omega = greatest_omega(cloth)
    for part, stable in ((1.98, True), (2.02, False)):
        x = Twin(cloth, Steps(part / omega, 1, 1, "springs"), NOTHING).advance(400).positions
        assert (abs(x[1, 0] - x[0, 0]) < 5.0) == stable


@every_method
def test_a_hanging_weight_stretches_its_spring_by_its_weight(steps):
    cloth = replace(two_particles(masses=(0.0, 0.1)), damping=20.0)
    state = Twin(cloth, steps, replace(VACUUM, gravity=(9.81, 0.0, 0.0))).advance(80)
    assert state.positions[1, 0] - 1.0 == pytest.approx(0.1 * 9.81 / 50.0, rel=1e-4)
    assert abs(state.velocities).max() < 1e-4


@every_method
def test_damping_takes_the_same_part_of_a_velocity_whatever_the_step(steps):
    cloth = sheet(3, 3, pins=[], damping_per_s=1.5, **SOFT)
    for dt in (1 / 60, 1 / 30):
        twin = Twin(cloth, replace(steps, dt=dt), NOTHING)
        twin.state.velocities[:] = (1.0, 2.0, 3.0)
        count = round(0.2 / dt)
        v = twin.advance(count).velocities
        assert np.allclose(v, np.array([1.0, 2.0, 3.0]) * math.exp(-1.5 * count * dt), rtol=1e-9)


# --- cloth in empty space ---------------------------------------------------------------------------------------------


@every_method
@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_at_rest_without_weight_nothing_moves_by_a_bit(steps, dtype):
    rng = np.random.default_rng(5)
    positions, triangles, _ = cloths.grid(6, 5)
    positions += rng.normal(size=positions.shape) * 0.02
    cloth = build_cloth(positions, triangles, {"pins": [0, 5]})
    (cloth,), steps, _ = fit_steps([cloth], steps)
    twin = Twin(cloth, steps, Forces(gravity=(0.0, 0.0, 0.0)), dtype=dtype)
    state = twin.advance(5)
    assert np.array_equal(state.positions, positions.astype(dtype))
    assert not state.velocities.any()


@every_method
def test_momentum_stays(steps):
    cloth = sheet(5, 4, pins=[], damping_per_s=0.0)
    (cloth,), steps, _ = fit_steps([cloth], steps)
    twin = Twin(cloth, steps, NOTHING)
    twin.state.velocities[:] = np.random.default_rng(2).normal(size=cloth.positions.shape)
    before = measures.momentum(cloth, twin.state)
    after = measures.momentum(cloth, twin.advance(20))
    assert np.allclose(before, after, rtol=0, atol=1e-14)


def energies(steps: Steps, h_omega: float, count: int = 1000) -> np.ndarray:
    """Return (count,) the energy after each substep over the first one, of a cloth that swings in all its ways."""
    cloth = sheet(5, 5, damping_per_s=0.0, stretch_n_per_m=100)
    steps = replace(steps, dt=h_omega / greatest_omega(cloth), substeps=1)
    twin = Twin(cloth, steps, NOTHING)
    noise = np.random.default_rng(1).normal(size=cloth.positions.shape) * 0.3
    twin.state.velocities[:] = np.where(cloth.held[:, None], 0.0, noise)
    first = measures.energy(cloth, twin.state, NOTHING).total
    return np.array([measures.energy(cloth, twin.advance(), NOTHING).total for _ in range(count)]) / first


@pytest.mark.parametrize(("steps", "h_omega"), [(EULER, 0.02), (VERLET, 0.2)], ids=["euler", "verlet"])
def test_energy_stays_within_a_hundredth_without_a_trend(steps, h_omega):
    found = energies(steps, h_omega)
    assert np.abs(found - 1.0).max() < 0.01
    halves = found[: len(found) // 2].mean(), found[len(found) // 2 :].mean()
    assert abs(halves[0] - halves[1]) < 0.001
    assert np.ptp(found) > 1e-7  # it does go to and fro between springs and motion


def test_xpbd_loses_energy_and_the_less_the_shorter_its_steps():
    losses = []
    for h_omega, count in ((0.4, 100), (0.2, 200), (0.1, 400)):
        found = energies(XPBD, h_omega, count)
        assert found[-1] < found[0] <= 1.0 + 1e-9
        assert (np.diff(found) < 0).mean() > 0.95
        losses.append(1.0 - found[-1])
    assert losses[0] > 1.3 * losses[1] > 1.3 * 1.3 * losses[2]


# --- held -------------------------------------------------------------------------------------------------------------


@every_method
def test_what_is_held_stays_to_the_bit_and_goes_where_its_node_goes(steps):
    cloth = sheet(5, 4)
    (cloth,), steps, _ = fit_steps([cloth], steps)
    twin = Twin(cloth, steps, Forces(wind=(1.0, 0.0, 5.0)), dtype=np.float32)
    rest = twin.model.positions[cloth.held]
    assert np.array_equal(twin.advance(10).positions[cloth.held], rest)
    assert not np.array_equal(twin.state.positions[~cloth.held], twin.model.positions[~cloth.held])
    after = np.eye(4)
    after[:3, 3] = (0.5, 0.25, -0.125)
    twin.advance(1, np.eye(4), after)
    assert np.array_equal(twin.state.positions[cloth.held], rest + np.float32((0.5, 0.25, -0.125)))
    assert np.allclose(twin.state.velocities[cloth.held], np.array((0.5, 0.25, -0.125)) / steps.dt, rtol=1e-3)


@every_method
def test_steps_of_one_frame_or_of_many_give_the_same_bits(steps):
    cloth = sheet(4, 4)
    (cloth,), steps, _ = fit_steps([cloth], steps)
    forces = Forces(wind=(0.0, 0.0, 3.0))
    at_once, one_by_one = Twin(cloth, steps, forces), Twin(cloth, steps, forces)
    at_once.advance(6)
    for count in (1, 2, 0, 3):
        one_by_one.advance(count)
    assert np.array_equal(at_once.state.positions, one_by_one.state.positions)
    assert np.array_equal(at_once.state.velocities, one_by_one.state.velocities)


# --- air --------------------------------------------------------------------------------------------------------------


@every_method
def test_a_flat_sheet_falls_as_air_lets_it(steps):
    cloth = sheet(3, 3, pins=[], damping_per_s=0.0, kg_per_m2=0.2, drag=1.2, **SOFT)
    cloth = replace(
        cloth, positions=cloth.positions[:, [0, 2, 1]]
    )  # level: it falls with its whole area ahead
    twin = Twin(cloth, replace(steps, substeps=24), Forces(air_density=1.2))
    terminal = math.sqrt(2 * 0.2 * 9.81 / (1.2 * 1.2))
    for seconds in (0.1, 0.2, 0.5):
        twin.advance(round(seconds / steps.dt) - twin.state.steps)
        v = twin.state.velocities
        assert np.allclose(v[:, 1], -terminal * math.tanh(9.81 * seconds / terminal), rtol=4e-3)
        assert np.abs(v[:, [0, 2]]).max() < 1e-12


@every_method
def test_wind_carries_a_free_sheet_up_to_its_own_speed(steps):
    cloth = sheet(3, 3, pins=[], damping_per_s=0.0, **SOFT)
    steps = replace(steps, substeps=4)
    twin = Twin(cloth, steps, Forces(gravity=(0.0, 0.0, 0.0), wind=(0.0, 0.0, 100.0)))
    speeds = [twin.advance().velocities[:, 2].mean() for _ in range(20)]
    assert (np.diff(speeds) > 0).all()
    assert 95.0 < speeds[-1] < 100.0  # and not beyond, however strong the gust and long the step
    along = Twin(cloth, steps, Forces(gravity=(0.0, 0.0, 0.0), wind=(5.0, 0.0, 0.0))).advance(10)
    assert not along.velocities.any()  # what blows along a sheet does not push it


# --- contact ----------------------------------------------------------------------------------------------------------


def plane(degrees: float = 0.0) -> Collider:
    """Return the ground y = 0, turned about z: it falls off towards +x for negative degrees."""
    turn = math.radians(degrees)
    matrix = np.eye(4)
    matrix[:2, :2] = ((math.cos(turn), -math.sin(turn)), (math.sin(turn), math.cos(turn)))
    return Collider("plane", matrix)


def level(edge: float = 0.1, height: float = 0.0, **properties) -> Cloth:
    """Return a free sheet that lies level at a height."""
    properties = {**SOFT, "damping_per_s": 0.0, "thickness_m": 0.0, **properties}
    cloth = sheet(3, 3, edge, pins=[], **properties)
    positions = cloth.positions[:, [0, 2, 1]] + (0.0, height, 0.0)
    return replace(cloth, positions=positions)


@every_method
@pytest.mark.parametrize("friction", [0.0, 0.2, 0.8])
def test_on_a_slope_friction_holds_or_slows(steps, friction):
    slope = plane(-30.0)
    cloth = level(friction=friction)
    turned = cloth.positions @ slope.world_from_collider[:3, :3].T
    cloth = replace(cloth, positions=turned)
    seconds = 0.3
    state = Twin(cloth, steps, VACUUM, [slope]).advance(round(seconds / steps.dt))
    speed = state.velocities @ slope.world_from_collider[:3, 0]
    gone = (state.positions - turned) @ slope.world_from_collider[:3, 0]
    along = 9.81 * max(0.0, math.sin(math.radians(30)) - friction * math.cos(math.radians(30)))
    assert np.allclose(speed, along * seconds, rtol=0.01, atol=1e-9)
    assert np.allclose(gone, along * seconds**2 / 2, rtol=0.03, atol=1e-6)


def turned_box() -> Collider:
    matrix = np.eye(4)
    matrix[:3, :3] = np.array([[0.8, 0.0, 0.6], [0.0, 1.0, 0.0], [-0.6, 0.0, 0.8]]) * (0.4, 0.2, 0.3)
    matrix[:3, 3] = (0.1, -0.3, -0.1)
    return Collider("box", matrix, half=(1.0, 1.0, 1.0))


def ball() -> Collider:
    matrix = np.diag([5.0, 5.0, 5.0, 1.0])
    matrix[:3, 3] = (0.05, -0.99, 0.05)
    return Collider("sphere", matrix, radius=0.2)


@every_method
@pytest.mark.parametrize("collider", [plane(), ball(), turned_box()], ids=["plane", "sphere", "box"])
def test_what_falls_on_something_comes_to_lie_outside_of_it(steps, collider):
    cloth = level(0.05, 0.1, damping_per_s=2.0, thickness_m=0.01, friction=0.6, stretch_n_per_m=20)
    twin = Twin(cloth, steps, VACUUM, [collider])
    begin = measures.energy(cloth, twin.state, VACUUM).total
    deepest = 0.0
    for _ in range(30):
        deepest = max(deepest, measures.penetration(cloth, twin.advance(), [collider]))
    assert deepest == 0.0
    end = measures.energy(cloth, twin.state, VACUUM)
    assert end.total < begin
    assert end.kinetic < 1e-3
    assert measures.stretch(cloth, twin.state).greatest < 0.2


def test_depth_is_measured_from_the_surface():
    cloth = level()
    state = State(cloth.positions - np.array([0.0, 0.03, 0.0]), np.zeros_like(cloth.positions))
    assert measures.penetration(cloth, state, [plane()]) == pytest.approx(0.03)
    cube = Collider("box", np.eye(4), half=(0.5, 0.05, 0.5))
    assert measures.penetration(cloth, state, [cube]) == pytest.approx(0.02)
    assert measures.penetration(cloth, state, [Collider("sphere", np.eye(4), 0.05)]) == pytest.approx(0.02)


@pytest.mark.parametrize("shape", ["sphere", "plane", "box"])
def test_the_way_out_of_a_collider_ends_on_its_surface(shape):
    rng = np.random.default_rng(12)
    q = np.concatenate([rng.uniform(-2, 2, (500, 3)), np.eye(3), -np.eye(3), np.zeros((1, 3))])
    size = np.array([1.0, 0.5, 0.8]) if shape == "box" else np.full(3, 0.9)
    depth, out = depth_below(shape, q, size)
    assert np.allclose(np.linalg.norm(out, axis=1), 1.0)
    assert np.allclose(depth_below(shape, q + depth[:, None] * out, size)[0], 0.0, atol=1e-12)
    surface = rng.normal(size=(20_000, 3))
    if shape == "sphere":
        surface *= 0.9 / np.linalg.norm(surface, axis=1, keepdims=True)
    elif shape == "box":
        surface /= np.abs(surface).max(axis=1, keepdims=True)
        surface *= size
    else:
        return
    inside = (np.abs(q) < size).all(axis=1) if shape == "box" else np.linalg.norm(q, axis=1) < 0.9
    nearest = np.array([np.linalg.norm(surface - one, axis=1).min() for one in q[:60]])
    assert np.allclose(np.abs(depth[:60]), nearest, atol=0.05)
    assert ((depth > 0) == inside).mean() > 0.99


# --- by hand ----------------------------------------------------------------------------------------------------------


def by_hand(cloth: Cloth, steps: Steps, forces: Forces, speeds: np.ndarray, count: int) -> np.ndarray:
    """Return the positions `count` steps after these speeds, from loops over particles and springs."""
    model = model_of(cloth, np.float64)
    x = [list(map(float, place)) for place in model.positions]
    v = speeds.tolist()
    mass, h, k_of, rest = cloth.masses.tolist(), steps.h, model.stiffness.tolist(), model.rest.tolist()
    ends = model.springs.tolist()
    gravity = forces.gravity

    def length(a, b):
        return math.dist(x[a], x[b])

    def kick(w):
        force = [[0.0] * 3 for _ in x]
        for (a, b), k, l0 in zip(ends, k_of, rest, strict=True):
            distance = length(a, b)
            for axis in range(3):
                pull = k * (distance - l0) * (x[b][axis] - x[a][axis]) / distance
                force[a][axis] += pull
                force[b][axis] -= pull
        for i, m in enumerate(mass):
            if m > 0:
                damp = math.exp(-cloth.damping * w)
                v[i] = [(v[i][n] + w * (force[i][n] / m + gravity[n])) * damp for n in range(3)]

    def drift():
        for i in range(len(x)):
            x[i] = [x[i][n] + h * v[i][n] for n in range(3)]

    def xpbd():
        before = [list(place) for place in x]
        for i, m in enumerate(mass):
            if m > 0:
                x[i] = [x[i][n] + h * (v[i][n] + h * gravity[n]) for n in range(3)]
        multipliers = [0.0] * len(ends)
        for _ in range(steps.iterations):
            for s, (a, b) in enumerate(ends):
                wa, wb = (1 / mass[i] if mass[i] > 0 else 0.0 for i in (a, b))
                distance, alpha = length(a, b), 1 / (k_of[s] * h * h)
                change = (rest[s] - distance - alpha * multipliers[s]) / (wa + wb + alpha)
                multipliers[s] += change
                way = [(x[b][n] - x[a][n]) / distance for n in range(3)]
                x[a] = [x[a][n] - wa * change * way[n] for n in range(3)]
                x[b] = [x[b][n] + wb * change * way[n] for n in range(3)]
        for i, m in enumerate(mass):
            if m > 0:
                v[i] = [(x[i][n] - before[i][n]) / h * math.exp(-cloth.damping * h) for n in range(3)]

    for _ in range(count):
        for substep in range(steps.substeps):
            if steps.method == "xpbd":
                xpbd()
            elif steps.integrator == "euler":
                kick(h)
                drift()
            else:
                kick(h / 2 if substep == 0 else h)
                drift()
                if substep == steps.substeps - 1:
                    kick(h / 2)
    return np.array(x)


@every_method
def test_the_twin_does_what_loops_over_particles_do(steps):
    cloth = sheet(4, 3, stretch_n_per_m=100)
    (cloth,), steps, _ = fit_steps([cloth], replace(steps, substeps=4, iterations=2))
    twin = Twin(cloth, steps, VACUUM)
    speeds = np.where(cloth.held[:, None], 0.0, np.random.default_rng(8).normal(size=(12, 3)))
    twin.state.velocities[:] = speeds
    found = twin.advance(6).positions
    truth = by_hand(cloth, steps, VACUUM, speeds, 6)
    assert np.allclose(found, truth, rtol=0, atol=1e-10)
    assert np.abs(truth - cloth.positions).max() > 0.01


def test_stretch_is_that_of_the_threads_alone():
    """Of a sheet that is twice as wide, half of the threads have twice their length. Other springs do not count."""
    cloth = level()
    twin = Twin(cloth, Steps(), VACUUM)
    assert measures.stretch(cloth, twin.state).greatest == pytest.approx(0, abs=1e-6)
    wide = twin.state.positions * (2, 1, 1)
    found = measures.stretch(cloth, replace(twin.state, positions=wide))
    assert found.greatest == pytest.approx(1, abs=1e-6) and found.rms == pytest.approx(
        math.sqrt(0.5), abs=1e-6
    )
