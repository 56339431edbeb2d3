"""Cloth on the GPU: every execution gives the bits of every other one, and the numbers of the twin on the CPU."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from backends import shader_text
from backends.vulkan.shaders import compile_shader
from chapters.ch05.benches import measures as measures
from chapters.ch05.benches.twin import Twin
from chapters.ch05.cloth import dispatches as jobs
from chapters.ch05.cloth import layout as layout
from chapters.ch05.cloth.build import build_cloth
from chapters.ch05.cloth.dispatches import Moment, dispatches, frame_arrays, states_of
from chapters.ch05.cloth.layout import Drawn, pack
from chapters.ch05.cloth.steps import fit_steps
from chapters.ch05.cloth.types import Cloth, Collider, Forces, State, Steps
from chapters.ch05.pipelines.spirv.parser import parse
from chapters.ch05.pipelines.vulkan import CHAPTER
from tests.support import cloths

pytestmark = pytest.mark.variants("vulkan", "gl")  # the kernels need nothing that a device may lack

sheet = partial(cloths.sheet, build_cloth)
run = partial(cloths.run, CHAPTER)
simulation = pytest.mark.feature("cloth/spring-simulation")

SPRINGS = Steps(substeps=3, method="springs", integrator="verlet")
EULER = Steps(substeps=3, method="springs", integrator="euler")
XPBD = Steps(substeps=2, iterations=2)
METHODS = {"xpbd": XPBD, "euler": EULER, "verlet": SPRINGS}
every_method = pytest.mark.parametrize("steps", METHODS.values(), ids=METHODS)
OTHERS = [pytest.param("thread", marks=pytest.mark.long), "dispatch"]
"""What is compared with a group: a software driver compiles the kernel of one thread for 5 s, which only this needs."""
WEAK = {"stretch_n_per_m": 5, "shear_n_per_m": 3, "bend_n_per_m": 1}
WIND = Forces(wind=(1.0, 0.5, 4.0))


def simulated(
    device, made, steps, count, execution="group", forces=WIND, colliders=(), begin=None, moment=None
):
    """Return the state of each cloth after `count` steps; `begin` are states to start from."""
    packed = pack(made, colliders=len(colliders))
    moment = moment or Moment.still(len(made), count, begin=begin is None)
    arrays = frame_arrays(packed, steps, forces, moment, colliders)
    for name in ("positions", "velocities") if begin else ():
        arrays[name] = np.concatenate([getattr(state, name) for state in begin]).astype(np.float32)
    found = run(device, packed, dispatches(packed, steps, count, execution), arrays)
    return states_of(packed, found["positions"], found["velocities"])


def same(a, b):
    return np.array_equal(a.positions, b.positions) and np.array_equal(a.velocities, b.velocities)


def ball(x=0.2, y=-0.35, z=0.12, radius=0.1):
    matrix = np.eye(4)
    matrix[:3, 3] = (x, y, z)
    return Collider("sphere", matrix, radius)


def box():
    matrix = np.eye(4)
    matrix[:3, :3] = np.array([[0.8, 0.0, 0.6], [0.0, 1.0, 0.0], [-0.6, 0.0, 0.8]])
    matrix[:3, 3] = (0.0, -0.45, 0.1)
    return Collider("box", matrix, half=(0.08, 0.1, 0.06))


def ground():
    matrix = np.eye(4)
    matrix[1, 3] = -0.5
    return Collider("plane", matrix)


def shaken(cloth, steps, forces, count, colliders=()):
    """Return how far a step's last rounding carries: the farthest that twins get from each other in `count` steps.

    Numpy and software drivers round a division and a square root once. Vulkan lets a device be 2.5 units of the last
    place off in a division and about 3 in a root ("Precision and Operation of SPIR-V Instructions"), in every spring of
    every substep. Here free particles are moved by up to two units after each step, and what comes of that is measured.
    """
    still = Twin(cloth, steps, forces, colliders, np.float32).advance(count).positions
    farthest = 0.0
    for seed in range(4):
        rng, twin = np.random.default_rng(seed), Twin(cloth, steps, forces, colliders, np.float32)
        for _ in range(count):
            x = twin.advance().positions
            moves = rng.integers(-2, 3, x.shape) * np.spacing(np.abs(x).max()) * ~cloth.held[:, None]
            twin.state = replace(twin.state, positions=(x + moves).astype(np.float32))
        farthest = max(farthest, float(np.abs(twin.state.positions - still).max()))
    return farthest


# --- the twin ---------------------------------------------------------------------------------------------------------


@simulation
@every_method
def test_after_a_hundred_steps_the_gpu_is_where_the_twins_are(chapter, steps):
    made = [sheet(5, 5, **WEAK), sheet(3, 2, **WEAK)]
    made, fitted, _ = fit_steps(made, steps)
    assert fitted.substeps == steps.substeps
    for cloth, state in zip(made, simulated(chapter.device, made, fitted, 100), strict=True):
        extent = np.ptp(cloth.positions, axis=0).max()
        near = 1e-5 * extent
        if not chapter.device.capabilities.is_software:
            near = max(near, shaken(cloth, fitted, WIND, 100))
        for dtype, bound in ((np.float32, near), (np.float64, 1e-4 * extent)):
            twin = Twin(cloth, fitted, WIND, dtype=dtype).advance(100)
            assert np.abs(twin.positions - state.positions).max() <= bound
        assert np.abs(state.positions - cloth.positions).max() > 0.05  # it did blow about
        assert np.array_equal(state.positions[cloth.held], cloth.positions[cloth.held].astype(np.float32))


MASS, STRETCH, REST, BEGUN = 0.1, 2.0, 0.9, 0.1


def one_spring(places):
    """Return two free particles with one spring, which is stretched by BEGUN, without damping and triangles."""
    return Cloth(
        mesh=0,
        node=0,
        anchor=np.zeros(3),
        positions=places,
        masses=np.full(2, MASS),
        springs=np.array([[0, 1]], np.int32),
        kinds=np.zeros(1, np.uint8),
        rest=np.array([REST]),
        stiffness=np.array([STRETCH, 1.0, 1.0]),
        triangles=np.zeros((0, 3), np.int32),
        particle_of=np.arange(2, dtype=np.int32),
        damping=0.0,
    )


def lengths_of_one_spring(steps, count, stiffness=STRETCH):
    """Return how long a spring between two free particles is after `count` steps: the steps' own solutions, by hand.

    With two masses m it swings with omega^2 = 2 k / m. A step h of Verlet turns the swing by the angle a of
    2 sin(a / 2) = h omega, Euler's by the same with half a step ahead. XPBD's first iteration for one spring is an
    implicit step of Euler, which divides the complex amplitude by 1 + i h omega, and leaves nothing to a second one.
    """
    h, n = steps.h, count * steps.substeps
    turn = h * np.sqrt(2 * stiffness / MASS)
    angle = 2 * np.arcsin(turn / 2)
    if steps.method == "xpbd":
        return REST + BEGUN * (1 / (1 + 1j * turn) ** n).real
    if steps.integrator == "euler":
        return REST + BEGUN * np.cos((n + 0.5) * angle) / np.cos(angle / 2)
    return REST + BEGUN * np.cos(n * angle)


@simulation
@every_method
def test_one_spring_is_as_long_as_the_closed_form_says_and_not_as_another_one(chapter, steps):
    """Without the twin, which could be wrong as the kernels are."""
    places = np.array([[0.0, 0.0, 0.0], [REST + BEGUN, 0.0, 0.0]])
    cloth = one_spring(places)
    nothing = Forces(gravity=(0.0, 0.0, 0.0), air_density=0.0)
    for count in (1, 7, 100):
        (state,) = simulated(chapter.device, [cloth], steps, count, forces=nothing)
        length = float(state.positions[1, 0]) - float(state.positions[0, 0])
        assert abs(length - lengths_of_one_spring(steps, count)) <= 1e-5
        assert np.abs(state.positions[:2, 0].mean() - places[:, 0].mean()) <= 1e-5
        if count > 1:
            assert abs(length - lengths_of_one_spring(steps, count, 1.01 * STRETCH)) > 1e-5
            assert abs(length - lengths_of_one_spring(replace(steps, dt=1.01 * steps.dt), count)) > 1e-5


@simulation
@every_method
@pytest.mark.parametrize("other", OTHERS)
def test_thread_group_and_dispatch_give_the_same_bits(chapter, steps, other):
    colliders = [ball(), box(), ground()]
    made = [sheet(6, 5, pins=[0], **WEAK), sheet(4, 7, **WEAK), sheet(2, 2, **WEAK)]
    began = [Twin(cloth, XPBD, WIND, dtype=np.float32).advance(12) for cloth in made]
    moved = np.tile(np.eye(4), (3, 1, 1))
    moved[0, :3, 3] = (0.05, 0.0, 0.02)
    moved[1, :2, :2] = ((0.96, -0.28), (0.28, 0.96))
    moment = Moment(np.array([2, 1, 2]), np.zeros(3, bool), np.ones(3, bool), Moment.still(3).before, moved)
    states = {
        execution: simulated(
            chapter.device, made, steps, 2, execution, colliders=colliders, begin=began, moment=moment
        )
        for execution in ("group", other)
    }
    for number, cloth in enumerate(made):
        assert same(states["group"][number], states[other][number])
        goal = cloth.positions[cloth.held] @ moved[number, :3, :3].T + moved[number, :3, 3]
        held = states["group"][number].positions[cloth.held]
        assert np.allclose(held, goal, rtol=0, atol=1e-7)
        if number == 0:  # one rounding, which is none of the way there
            assert np.array_equal(
                held, cloth.positions[cloth.held].astype(np.float32) + np.float32(moved[0, :3, 3])
            )
        twin = Twin(cloth, steps, WIND, colliders, np.float32)
        twin.state = began[number]
        twin.advance(int(moment.steps[number]), np.eye(4), moved[number])
        assert np.abs(twin.state.positions - states["group"][number].positions).max() < 1e-5


@simulation
@pytest.mark.variants("gl")
@pytest.mark.parametrize("steps", [XPBD, SPRINGS], ids=["xpbd", "springs"])
def test_vulkan_and_opengl_give_the_same_bits(vulkan_device, gl_context, steps):
    made = [sheet(5, 6, pins=[0], **WEAK)]
    states = [
        simulated(device, made, steps, 20, colliders=[ball(), box()])
        for device in (vulkan_device, gl_context)
    ]
    if vulkan_device.capabilities.is_software and gl_context.capabilities.is_software:
        assert same(states[0][0], states[1][0])
    else:  # two compilers, of which each divides and takes roots in its way
        spread = 2 * shaken(made[0], steps, WIND, 20, [ball(), box()])
        assert np.abs(states[0][0].positions - states[1][0].positions).max() <= max(spread, 1e-5)


@simulation
@every_method
def test_at_rest_without_weight_no_bit_changes(chapter, steps):
    cloth = sheet(6, 5, 0.07)
    rng = np.random.default_rng(4)
    moved = cloth.positions + rng.normal(size=cloth.positions.shape) * 0.01
    rest = np.linalg.norm(moved[cloth.springs[:, 0]] - moved[cloth.springs[:, 1]], axis=1)
    made, fitted, _ = fit_steps([replace(cloth, positions=moved, rest=rest)], steps)
    (state,) = simulated(chapter.device, made, fitted, 20, forces=Forces(gravity=(0.0, 0.0, 0.0)))
    assert np.array_equal(state.positions, moved.astype(np.float32))
    assert not state.velocities.any()


@every_method
def test_cloths_side_by_side_are_as_each_alone(chapter, steps):
    made = [sheet(5, 5, **WEAK), sheet(2, 9, pins=[0], **WEAK), sheet(7, 3, pins=[], **WEAK)]
    together = simulated(chapter.device, made, steps, 8, colliders=[ground()])
    for cloth, state in zip(made, together, strict=True):
        assert same(simulated(chapter.device, [cloth], steps, 8, colliders=[ground()])[0], state)


@every_method
def test_what_rests_stays_and_what_begins_anew_is_at_rest(chapter, steps):
    made = [sheet(4, 4, **WEAK), sheet(3, 3, **WEAK), sheet(3, 4, **WEAK)]
    began = [Twin(cloth, XPBD, WIND, dtype=np.float32).advance(6) for cloth in made]
    anew = np.array([False, False, True])
    moment = replace(Moment.still(3, 0), steps=np.array([0, 3, 0]), begin=anew)
    asleep, awake, reset = simulated(chapter.device, made, steps, 3, begin=began, moment=moment)
    assert same(asleep, began[0])
    assert not same(awake, began[1])
    assert np.array_equal(reset.positions, made[2].positions.astype(np.float32))
    assert not reset.velocities.any()


# --- what would break it ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("method", ["xpbd", "springs"])
def test_no_step_and_no_stiffness_makes_anything_not_finite(chapter, method):
    positions, triangles, _ = cloths.grid(4, 4)
    positions = np.concatenate([positions, [[0.05, 0.0, 0.0]]])
    triangles = np.concatenate([triangles, [[0, 1, 16], [5, 5, 6]]])  # both without area
    for dt in (1 / 1000, 1 / 15):
        made = [build_cloth(positions, triangles, {"pins": [0], "stretch_n_per_m": k}) for k in (1, 1e6)]
        steps = Steps(dt=dt, substeps=2, method=method)
        made, steps, _ = fit_steps(made, steps)
        states = simulated(chapter.device, made, steps, 15, colliders=[ball(), ground()])
        for cloth, state in zip(made, states, strict=True):
            assert np.isfinite(state.positions).all()
            assert np.isfinite(state.velocities).all()
            assert np.abs(state.velocities).max() < 50.0
            assert np.array_equal(state.positions[cloth.held], cloth.positions[cloth.held].astype(np.float32))


@pytest.mark.parametrize("steps", [XPBD, SPRINGS], ids=["xpbd", "springs"])
def test_particles_at_one_place_give_no_nan(chapter, steps):
    cloth = sheet(3, 3, pins=[], **WEAK)
    heap = State(np.zeros((9, 3)), np.zeros((9, 3)))
    (state,) = simulated(chapter.device, [cloth], steps, 4, colliders=[ball(0, 0, 0)], begin=[heap])
    assert np.isfinite(state.positions).all()
    assert np.isfinite(state.velocities).all()


@pytest.mark.parametrize("steps", [XPBD, SPRINGS], ids=["xpbd", "springs"])
def test_with_contact_energy_stretch_and_depth_are_those_of_the_twin(chapter, steps):
    # Wind presses it against a ball.
    cloth = sheet(6, 6, pins=range(6), damping_per_s=4.0, **WEAK)
    colliders = [ball(0.27, -0.45, -0.25, 0.3), ground()]
    wind = Forces(wind=(0.3, 0.0, -2.0))
    (state,) = simulated(chapter.device, [cloth], steps, 40, colliders=colliders, forces=wind)
    truth = Twin(cloth, steps, wind, colliders).advance(40)
    energies = [measures.energy(cloth, one, wind) for one in (state, truth)]
    assert energies[0].total == pytest.approx(energies[1].total, rel=1e-3)
    assert energies[0].elastic == pytest.approx(energies[1].elastic, rel=0.01)
    stretches = [measures.stretch(cloth, one) for one in (state, truth)]
    assert stretches[0].rms == pytest.approx(stretches[1].rms, rel=0.01)
    assert stretches[0].greatest == pytest.approx(stretches[1].greatest, rel=0.01)
    assert measures.penetration(cloth, state, colliders) < 1e-6
    untouched = Twin(cloth, steps, wind).advance(40)
    assert np.abs(untouched.positions - truth.positions).max() > 0.05


@pytest.mark.parametrize("steps", [XPBD, SPRINGS], ids=["xpbd", "springs"])
@pytest.mark.parametrize("collider", [ball(0, 0, 0, 0.5), box(), ground()], ids=["sphere", "box", "plane"])
def test_a_particle_meets_a_collider_as_in_the_twin(chapter, steps, collider):
    cloth = sheet(8, 8, pins=[], thickness_m=0.05, drag=0.0, **WEAK)
    rng = np.random.default_rng(7)
    centre = collider.world_from_collider[:3, 3]
    spread = np.array(collider.half) if collider.shape == "box" else 0.5
    places = (rng.uniform(-1.5, 1.5, (64, 3)) * spread + centre).astype(np.float32)
    begin = State(places, rng.normal(size=(64, 3)).astype(np.float32))
    steps = replace(steps, dt=1e-4, substeps=1)
    (state,) = simulated(chapter.device, [cloth], steps, 1, colliders=[collider], begin=[begin])
    twin = Twin(cloth, steps, WIND, [collider], np.float32)
    twin.state = begin
    free = Twin(cloth, steps, WIND, dtype=np.float32)
    free.state = State(places, begin.velocities)
    truth = twin.advance()
    assert np.abs(truth.positions - state.positions).max() < 1e-6
    assert np.abs(truth.velocities - state.velocities).max() < 1e-4 * np.abs(truth.velocities).max()
    touched = np.abs(free.advance().positions - state.positions).max(axis=1) > 1e-4
    assert 5 < touched.sum() < 60


# --- the surface ------------------------------------------------------------------------------------------------------


def surfaces(device, made, drawn, begin, moment=None):
    """Return the words of the page, (N,) float32 all 7 before, and the stats, for states as they are."""
    packed = pack(made, drawn)
    moment = moment or Moment.still(len(made), 0)
    arrays = frame_arrays(packed, XPBD, WIND, moment)
    for name in ("positions", "velocities"):
        arrays[name] = np.concatenate([getattr(state, name) for state in begin]).astype(np.float32)
    arrays["words"] = np.full(2000, 7.0, np.float32)
    return run(device, packed, jobs.surface_dispatches(packed), arrays, ("words", "stats", "normals"))


def normals_of(positions, triangles, vertices):
    """Return (V, 3) float64 unit normals: cross products of the triangles around, added up."""
    a, b, c = (positions[triangles[:, k]].astype(np.float64) for k in range(3))
    sums = np.zeros((vertices, 3))
    for corner in range(3):
        np.add.at(sums, triangles[:, corner], np.cross(b - a, c - a))
    return sums / np.linalg.norm(sums, axis=1, keepdims=True)


surface = pytest.mark.feature("cloth/normals-and-tangents")


@surface
@pytest.mark.parametrize("axes", [(0, 1, 2), (1, 2, 0), (2, 0, 1)], ids=["z", "x", "y"])
def test_a_flat_sheet_has_exact_normals_and_tangents(chapter, axes):
    positions, triangles, uv = cloths.grid(7, 5, 0.37)
    back = np.argsort(axes)
    cloth = build_cloth(positions[:, back], triangles, {"columns": 7, "rows": 5})
    drawn = Drawn(0, triangles, 0, 200, 400, uv)
    found = surfaces(chapter.device, [cloth], [drawn], [State(cloth.positions, 0 * cloth.positions)])["words"]
    places, normals = found[:105].reshape(-1, 3), found[200:305].reshape(-1, 3)
    tangents = found[400:540].reshape(-1, 4)
    assert np.array_equal(places, cloth.positions.astype(np.float32))
    assert np.array_equal(normals, np.tile(np.array([0.0, 0.0, 1.0])[back], (35, 1)))
    assert np.array_equal(tangents[:, :3], np.tile(np.array([1.0, 0.0, 0.0])[back], (35, 1)))
    assert (tangents[:, 3] == 7.0).all()  # the texture's handedness is not touched
    assert (found[540:] == 7.0).all()


@surface
def test_normals_and_tangents_are_those_of_the_cpu(chapter):
    rng = np.random.default_rng(9)
    positions, triangles, uv = cloths.grid(6, 5)
    # A seam: the middle column twice, with other texture coordinates on the right; and a vertex of no triangle.
    own = np.flatnonzero(np.isclose(positions[:, 0], 0.2))
    positions = np.concatenate([positions, positions[own], [[3.0, 3.0, 3.0]]])
    twin_of = {int(v): 30 + k for k, v in enumerate(own)}
    right = positions[triangles].mean(axis=1)[:, 0] > 0.2
    triangles[right] = np.vectorize(lambda v: twin_of.get(int(v), int(v)))(triangles[right])
    uv = np.concatenate([uv, uv[own], [[0, 0]]]).astype(np.float32)
    right_side = np.unique(triangles[right])
    uv[right_side] = uv[right_side][:, ::-1] * (-1.0, 1.0)  # turned on the right
    cloth = build_cloth(positions, triangles, {"pins": [0]})
    bent = cloth.positions + rng.normal(size=cloth.positions.shape) * 0.03
    speeds = rng.normal(size=bent.shape)
    drawn = Drawn(0, triangles, 0, 200, 400, uv)
    answer = surfaces(chapter.device, [cloth], [drawn], [State(bent, speeds)])
    found = answer["words"]
    bent = bent.astype(np.float32)
    truth = normals_of(bent, cloth.triangles, len(bent))
    normals = found[200 : 200 + 36 * 3].reshape(-1, 3)
    used = cloth.particle_of >= 0
    assert np.abs(normals[used] - truth[cloth.particle_of[used]]).max() < 1e-5
    assert np.abs(normals[used] - (0, 0, 1)).max() > 0.1, "those of the sheet before it was bent are others"
    assert (normals[35] == 7.0).all()  # of no triangle: not written
    tangents = found[400 : 400 + 36 * 4].reshape(-1, 4)
    places = bent[np.maximum(cloth.particle_of, 0)].astype(np.float64)
    for vertex in np.flatnonzero(used):
        along = np.zeros(3)
        for corners in triangles[(triangles == vertex).any(axis=1)]:
            edges = places[corners[1:]] - places[corners[0]]
            rise = np.float64(uv[corners[1:]]) - uv[corners[0]]
            area = abs(np.linalg.det(rise))
            along += np.linalg.solve(rise, edges)[0] * area  # dP/du
        n = truth[cloth.particle_of[vertex]]
        along -= n * (along @ n)
        assert np.abs(tangents[vertex, :3] - along / np.linalg.norm(along)).max() < 1e-5
    assert (tangents[:, 3] == 7.0).all()
    stats = jobs.stats_of(answer["stats"].view(np.uint8))
    assert np.array_equal(stats["low"][0], bent.min(axis=0))
    assert np.array_equal(stats["high"][0], bent.max(axis=0))
    fastest = (speeds.astype(np.float32).astype(np.float64) ** 2).sum(axis=1).max()
    assert stats["speed_squared"][0] == pytest.approx(fastest, rel=1e-6)
    assert stats["not_finite"][0] == 0.0


@pytest.mark.feature("cloth/soa-buffers")
@surface
def test_only_what_is_asked_for_is_written_and_each_where_it_belongs(chapter):
    made, drawn, begin = [], [], []
    for number, (columns, rows) in enumerate(((3, 3), (2, 4), (3, 2))):
        positions, triangles, uv = cloths.grid(columns, rows)
        made.append(build_cloth(positions + np.array([0, 0, number]), triangles, {}))
        at = 500 * number
        drawn.append(None if number == 1 else Drawn(0, triangles, at, layout.NOWHERE, at + 100, uv))
        begin.append(State(made[-1].positions, 0 * positions))
    found = surfaces(chapter.device, made, drawn, begin)["words"]
    assert np.array_equal(found[:27].reshape(-1, 3), made[0].positions.astype(np.float32))
    assert np.array_equal(found[1000:1018].reshape(-1, 3), made[2].positions.astype(np.float32))
    assert (
        np.delete(found, [*range(27), *range(100, 136), *range(1000, 1018), *range(1100, 1124)]) == 7.0
    ).all()
    hidden = replace(Moment.still(3, 0), write=np.array([False, True, True]))
    found = surfaces(chapter.device, made, drawn, begin, hidden)["words"]
    assert (found[:1000] == 7.0).all()
    assert np.array_equal(found[1000:1018].reshape(-1, 3), made[2].positions.astype(np.float32))


def test_triangles_without_area_and_texture_give_finite_unit_vectors(chapter):
    positions, triangles, uv = cloths.grid(3, 3)
    cloth = build_cloth(positions, triangles, {})
    drawn = Drawn(0, triangles, 0, 200, 400, 0 * uv)
    for places in (0 * positions, positions * (1, 0, 0), positions, positions * 1e-12):
        found = surfaces(chapter.device, [cloth], [drawn], [State(places, 0 * places)])["words"]
        normals, tangents = found[200:227].reshape(-1, 3), found[400:436].reshape(-1, 4)[:, :3]
        assert np.allclose(np.linalg.norm(normals, axis=1), 1.0, atol=1e-6)
        assert np.allclose(np.linalg.norm(tangents, axis=1), 1.0, atol=1e-6)
        assert np.abs((normals * tangents).sum(axis=1)).max() < 1e-6


def test_stats_tell_what_is_not_finite(chapter):
    made = [sheet(3, 3), sheet(4, 4)]
    begin = [State(cloth.positions.copy(), 0 * cloth.positions) for cloth in made]
    begin[1].velocities[5, 1] = np.nan
    stats = jobs.stats_of(surfaces(chapter.device, made, [None, None], begin)["stats"].view(np.uint8))
    assert stats["not_finite"].tolist() == [0.0, 1.0]


# --- the layout -------------------------------------------------------------------------------------------------------


def test_each_colour_has_a_thread_for_every_spring_and_less_than_a_group_more():
    packed = pack([sheet(23, 17)])
    found = [
        step for step in dispatches(packed, XPBD, 1, "dispatch") if ("CONSTRAIN_STAGE", 1) in step.kernel.own
    ]
    assert len(found) == XPBD.substeps * XPBD.iterations * len(packed.color_counts)
    assert max(packed.color_counts) > 2 * jobs.THREADS, "several groups"
    for step in found:
        idle = step.groups[0] * jobs.THREADS - packed.color_counts[step.push[2]]
        assert 0 <= idle < jobs.THREADS and step.groups[1:] == (1, 1)


def every_kernel():
    cloth = sheet(3, 3)
    packed = pack([cloth], [Drawn(0, cloth.triangles, 0)])
    found = {step.kernel for step in jobs.surface_dispatches(packed)}
    for steps in METHODS.values():
        for execution in ("thread", "group", "dispatch"):
            found |= {step.kernel for step in dispatches(packed, steps, 1, execution)}
    return sorted(found, key=repr)


RECORDS = {
    "table": (layout.HEADER, layout.CLOTH),
    "frame": (layout.GLOBALS, layout.CLOTH_FRAME),
    "colliders": (None, layout.COLLIDER),
}
"""By buffer: what stands at its beginning, and the records behind it."""


def offsets_of(record):
    return [record.fields[name][1] for name in record.names]


@pytest.mark.feature("cloth/soa-buffers")
@pytest.mark.variants("vulkan")
def test_buffers_are_laid_out_as_numpy_has_them(variant):
    arrays = pack([sheet(3, 3)]).arrays
    seen = set()
    for kernel in every_kernel():
        source = shader_text.build(CHAPTER / kernel.file, "vulkan", defines=kernel.defines)
        resources = {one.binding: one for one in parse(compile_shader(source)).resources}
        assert {*resources} <= set(range(len(kernel.buffers)))
        assert len(kernel.buffers) <= 12
        for binding, one in resources.items():
            name = kernel.buffers[binding]
            seen.add(name)
            *head, last = one.block.members
            assert last.counts == (0,)  # one open array a block, and it is the last
            if name in RECORDS:
                above, record = RECORDS[name]
                assert (last.offset, last.strides) == (above.itemsize if above else 0, (record.itemsize,))
                assert [member.offset for member in head] == (offsets_of(above) if above else [])
                # Numbers that numpy has one by one at the end are one vector in the shader.
                assert [member.offset for member in last.members] == offsets_of(record)[: len(last.members)]
            else:
                assert (head, last.strides) == ([], (4,))
                given = {"float": np.float32, "uint": np.uint32}[last.type]
                assert name in ("words", "stats") or arrays[name].dtype == given
    assert seen == {*pack([sheet(2, 2)]).sizes(), "words"}


@pytest.mark.feature("cloth/soa-buffers")
@pytest.mark.variants("vulkan")
def test_a_record_with_a_word_too_many_or_too_few_is_noticed(variant):
    """By what the test above compares: where members lie, and how far records are from each other."""
    kernel = next(one for one in every_kernel() if "table" in one.buffers)
    source = shader_text.build(CHAPTER / kernel.file, "vulkan", defines=kernel.defines)
    resources = {kernel.buffers[one.binding]: one for one in parse(compile_shader(source)).resources}
    *_, last = resources["table"].block.members
    fields = layout.CLOTH.descr
    assert [member.offset for member in last.members] == offsets_of(layout.CLOTH)[: len(last.members)]
    for wrong in (np.dtype([("more", "<u4"), *fields]), np.dtype(fields[1:])):
        assert last.strides != (wrong.itemsize,)
        assert [member.offset for member in last.members[1:]] != offsets_of(wrong)[1 : len(last.members)]


@pytest.mark.feature("cloth/soa-buffers")
@pytest.mark.variants("vulkan")
def test_what_a_kernel_only_reads_it_declares_readonly(variant):
    for kernel in every_kernel():
        text = shader_text.build(CHAPTER / kernel.file, "vulkan", defines=kernel.defines).text
        for name in kernel.buffers:
            block = f"buffer {name.capitalize()}_"
            line = next(line for line in text.splitlines() if block in line)
            assert ("readonly" in line) == (name not in kernel.written)
