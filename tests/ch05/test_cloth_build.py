"""From a mesh to a cloth: its springs and masses, and what becomes of meshes and numbers that are odd or wrong."""

from __future__ import annotations

from functools import partial

import numpy as np
import pytest

from chapters.ch05.benches.twin import Twin
from chapters.ch05.cloth.build import LEAST_MASS, MASS_WITHOUT_AREA, STIFFNESS, build_cloth
from chapters.ch05.cloth.layout import Limits, pack
from chapters.ch05.cloth.model import color_springs
from chapters.ch05.cloth.scene import Obstacle
from chapters.ch05.cloth.steps import (
    MARGIN,
    MAX_SUBSTEPS,
    due_steps,
    fit_steps,
    greatest_omega,
    motion_between,
)
from chapters.ch05.cloth.types import Collider, Forces, Steps
from common.errors import SceneError, SettingError, UserError
from tests.support import cloths

sheet = partial(cloths.sheet, build_cloth)


def pairs_of(cloth, kind):
    return {frozenset(pair) for pair in cloth.springs[cloth.kinds == kind].tolist()}


def test_a_grid_has_the_twelve_neighbours_of_provot():
    columns, rows = 5, 6
    cloth = sheet(columns, rows)
    middle = 2 * columns + 2  # two away from every edge
    found = {
        kind: sorted(next(iter(pair - {middle})) - middle for pair in pairs_of(cloth, kind) if middle in pair)
        for kind in range(3)
    }
    assert found == {0: [-5, -1, 1, 5], 1: [-6, -4, 4, 6], 2: [-10, -2, 2, 10]}
    corner = [pair for kind in range(3) for pair in pairs_of(cloth, kind) if 0 in pair]
    assert sorted(next(iter(pair - {0})) for pair in corner) == [1, 2, 5, 6, 10]
    assert len(cloth.springs) == len({frozenset(pair) for pair in cloth.springs.tolist()})
    assert np.allclose(cloth.rest[cloth.kinds == 0], 0.1)
    assert np.allclose(cloth.rest[cloth.kinds == 1], 0.1 * np.sqrt(2))
    assert np.allclose(cloth.rest[cloth.kinds == 2], 0.2)


def test_triangles_alone_give_threads_diagonals_and_folds():
    positions, triangles, _ = cloths.grid(3, 3)
    cloth = build_cloth(positions, triangles, {"pins": [0]})
    with_grid = sheet(3, 3)
    assert pairs_of(cloth, 0) == pairs_of(with_grid, 0)
    assert pairs_of(cloth, 1) == pairs_of(with_grid, 1)  # both diagonals of every quad
    # Over the edge between 1 and 4 lie 3 and 2: no diagonal of a quad, but a fold.
    assert pairs_of(cloth, 2) == {frozenset(pair) for pair in ((2, 3), (5, 6), (1, 6), (2, 7))}


def test_equal_sides_make_no_diagonal():
    height = np.sqrt(3) / 2
    positions = np.array([[0, 0, 0], [1, 0, 0], [0.5, height, 0], [1.5, height, 0]])
    cloth = build_cloth(positions, np.array([[0, 1, 2], [1, 3, 2]]), {})
    assert len(pairs_of(cloth, 0)) == 5
    assert pairs_of(cloth, 1) == set()
    assert pairs_of(cloth, 2) == {frozenset((0, 3))}


def test_masses_are_those_of_the_area():
    cloth = sheet(5, 4, 0.1, pins=[], kg_per_m2=0.25)
    assert cloth.masses.sum() == pytest.approx(0.25 * 0.4 * 0.3)
    assert cloth.masses[6] == pytest.approx(0.25 * 0.01)  # of one cell: a quarter of each of the four around
    held = sheet(5, 4, pins=[0, 4, 4])
    assert np.flatnonzero(held.held).tolist() == [0, 4]


def test_vertices_at_one_place_are_one_particle_and_unused_ones_none():
    positions, triangles, _ = cloths.grid(3, 2)
    seam = np.concatenate(
        [positions, positions[[1, 4]], [[9.0, 9.0, 9.0]]]
    )  # the middle column twice; one alone
    triangles = triangles.copy()
    right = (positions[triangles].mean(axis=1) > 0.1)[:, 0]
    triangles[right] = np.select([triangles[right] == 1, triangles[right] == 4], [6, 7], triangles[right])
    seam[7, 2] = -0.0
    cloth = build_cloth(seam, triangles, {"pins": [6]})
    assert cloth.particle_of.tolist() == [0, 1, 2, 3, 4, 5, 1, 4, -1]
    assert np.array_equal(cloth.positions, positions)
    assert np.flatnonzero(cloth.held).tolist() == [1]
    whole = build_cloth(positions, cloths.grid(3, 2)[1], {"pins": [1]})
    assert pairs_of(cloth, 0) == pairs_of(whole, 0)
    assert np.allclose(cloth.masses, whole.masses)


def test_one_triangle_is_a_cloth():
    cloth = build_cloth(np.eye(3), np.array([[0, 1, 2]]), {})
    assert len(cloth.springs) == 3
    assert any("no pins" in text for text in cloth.warnings)


def test_particles_without_area_get_the_least_mass_and_say_so():
    positions, triangles, _ = cloths.grid(3, 3)
    positions = np.concatenate([positions, [[0.05, 0.0, 0.0]]])
    thin = np.concatenate([triangles, [[0, 1, 9]]])  # on the edge between 0 and 1
    cloth = build_cloth(positions, thin, {"pins": [0]})
    free = build_cloth(positions, thin, {"pins": []})
    assert free.masses[9] == pytest.approx(LEAST_MASS * free.masses[:9].mean())
    assert any("1 of 10 particles" in text for text in cloth.warnings)
    nothing = build_cloth(np.array([[0, 0, 0], [1, 0, 0], [2, 0, 0]]), np.array([[0, 1, 2]]), {})
    assert (nothing.masses == MASS_WITHOUT_AREA).all()


def test_a_pin_on_an_unused_vertex_holds_nothing_and_says_so():
    positions, triangles, _ = cloths.grid(2, 2)
    cloth = build_cloth(np.concatenate([positions, [[5, 5, 5]]]), triangles, {"pins": [4]})
    assert any("holds nothing" in text for text in cloth.warnings)


def test_stiffness_beyond_what_can_be_simulated_is_clamped_and_told():
    cloth = sheet(3, 3, stretch_n_per_m=1e9, bend_n_per_m=0)
    assert cloth.stiffness.tolist() == [STIFFNESS[1], 60.0, STIFFNESS[0]]
    assert sum("is taken as" in text for text in cloth.warnings) == 2
    assert sheet(3, 3).warnings == ()


@pytest.mark.parametrize(
    "key", ["kg_per_m2", "stretch_n_per_m", "damping_per_s", "drag", "thickness_m", "friction"]
)
@pytest.mark.parametrize(
    "value",
    [-1.0, float("nan"), float("inf"), 1e300, pytest.param(10**400, id="401 digits"), "much", None, True],
)
def test_numbers_that_are_none_are_refused(key, value):
    with pytest.raises(SceneError, match=key):
        sheet(3, 3, **{key: value})


@pytest.mark.parametrize(
    ("changes", "match"),
    [
        ({"kg_per_m2": 0}, "at least 1e-06"),
        ({"kg_per_m2": 1e-300}, "at least 1e-06"),
        ({"pins": [10**30]}, "pinned at vertex 1000"),
        ({"pins": [9]}, "pinned at vertex 9"),
        ({"pins": [-1]}, "pinned at vertex -1"),
        ({"pins": "all"}, "list of numbers"),
        ({"pins": [0.5]}, "list of numbers"),
        ({"columns": 4}, "leave both out"),
        ({"rows": None}, "leave both out"),
        ({"columns": -3, "rows": -3}, "leave both out"),
    ],
)
def test_properties_that_do_not_fit_the_mesh_are_refused(changes, match):
    positions, triangles, _ = cloths.grid(3, 3)
    with pytest.raises(SceneError, match=match):
        build_cloth(positions, triangles, {"columns": 3, "rows": 3, **changes})


def test_meshes_that_are_none_are_refused():
    positions, triangles, _ = cloths.grid(2, 2)
    with pytest.raises(SceneError, match="no triangle"):
        build_cloth(positions, triangles[:0], {})
    with pytest.raises(SceneError, match="names a vertex"):
        build_cloth(positions, triangles + 1, {})
    with pytest.raises(SceneError, match="not finite"):
        build_cloth(positions * np.nan, triangles, {})
    with pytest.raises(SceneError, match=r"1e\+19 m large"):
        build_cloth(positions * 1e20, triangles, {})


@pytest.mark.parametrize("steps", [Steps(), Steps(method="springs")], ids=["xpbd", "springs"])
@pytest.mark.parametrize("size", [1e-20, 1e-8, 1e-3, 9e5])
@pytest.mark.parametrize(
    "fields", [{}, {"kg_per_m2": 1e-6}, {"kg_per_m2": 1e9, "drag": 1e9, "thickness_m": 1e9}]
)
def test_whatever_is_not_refused_stays_finite_in_32_bits(steps, size, fields):
    positions, triangles, _ = cloths.grid(3, 3)
    cloth = build_cloth(positions / 0.2 * size, triangles, {"pins": [0], "friction": 1e9, **fields})
    (cloth,), steps, _ = fit_steps([cloth], steps)
    ground = Collider("plane", np.eye(4))
    with np.errstate(over="ignore"):  # in quotients that are not taken
        twin = Twin(cloth, steps, Forces(wind=(60.0, 0.0, 0.0)), [ground], dtype=np.float32)
        state = twin.advance(4)
    assert np.isfinite(state.positions).all() and np.isfinite(state.velocities).all()


def test_springs_of_a_color_share_no_particle():
    cloth = sheet(9, 7)
    colors = color_springs(cloth.springs, len(cloth.positions))
    for color in range(colors.max() + 1):
        ends = cloth.springs[colors == color].reshape(-1)
        assert len(ends) == len(np.unique(ends)) > 0
    degrees = np.bincount(cloth.springs.reshape(-1))
    assert degrees.max() <= colors.max() + 1 <= 2 * degrees.max() - 1
    assert np.array_equal(colors, color_springs(cloth.springs, len(cloth.positions)))
    star = np.array([[0, k] for k in range(1, 100)])
    assert color_springs(star, 100).tolist() == list(range(99))


def test_springs_take_the_substeps_that_the_stiffest_needs():
    cloth = sheet(5, 5)
    steps = Steps(method="springs", substeps=1)
    (same,), fitted, notes = fit_steps([cloth], steps)
    omega = greatest_omega(cloth)
    assert same is cloth
    assert fitted.h * omega <= 2 * MARGIN < steps.dt / (fitted.substeps - 1) * omega
    assert "substeps" in notes[0]
    worst = max(
        2 * cloth.stiffness[cloth.kinds[(cloth.springs == i).any(axis=1)]].sum() / cloth.masses[i]
        for i in range(1, 4)
    )
    assert omega**2 >= worst
    assert fit_steps([cloth], Steps(method="xpbd", substeps=1)) == ([cloth], Steps(substeps=1), [])


def test_springs_too_stiff_for_the_most_substeps_are_made_softer_and_told():
    cloth = sheet(5, 5, stretch_n_per_m=1e6)
    (softer,), fitted, notes = fit_steps([cloth], Steps(dt=1 / 15, method="springs"))
    assert fitted.substeps == MAX_SUBSTEPS
    assert fitted.h * greatest_omega(softer) == pytest.approx(2 * MARGIN)
    assert np.allclose(softer.stiffness / cloth.stiffness, softer.stiffness[0] / cloth.stiffness[0])
    assert "softer" in notes[-1]
    with pytest.raises(SettingError):
        fit_steps([cloth], Steps(dt=0.0))


def test_a_frame_simulates_what_is_due_and_skips_what_is_too_much():
    dt = 1 / 60
    done = 0
    for frame in range(1, 200):
        due = due_steps(frame * dt, done, dt)
        assert (due.count, due.skipped) == (1, 0)
        done = due.reached
    assert due_steps(done * dt + 0.9 * dt, done, dt).count == 0
    hitch = due_steps(done * dt + 1.0, done, dt)
    assert (hitch.count, hitch.skipped, hitch.reached) == (15, 45, done + 60)
    assert "45 steps" in hitch.note
    assert due_steps(1.0, 0, 0.5).count == 1  # longer than a frame may simulate: one at a time
    assert due_steps(0.0, 100, dt) == due_steps(-5.0, 100, dt)
    assert due_steps(0.0, 100, dt).count == 0


def test_a_node_that_stands_still_moves_nothing():
    rng = np.random.default_rng(3)
    world = np.eye(4)
    world[:3] = rng.normal(size=(3, 4))
    anchor = rng.normal(size=3)
    assert np.array_equal(motion_between(world, world.copy(), anchor), np.eye(4))
    moved = world.copy()
    moved[:3, 3] += (1.0, 2.0, 3.0)
    assert np.allclose(motion_between(world, moved, anchor)[:3, 3], (1, 2, 3))
    turned = world @ np.diag([-1.0, 1.0, -1.0, 1.0])
    point = rng.normal(size=4)
    point[3] = 1.0
    there = motion_between(world, turned, anchor) @ np.append((world @ point)[:3] - anchor, 1.0)
    assert np.allclose(there[:3] + anchor, (turned @ point)[:3])


def test_limits_of_a_device_are_named():
    cloth = sheet(9, 9)
    with pytest.raises(UserError, match="maxStorageBufferRange"):
        pack([cloth], limits=Limits(storage_bytes=1024))
    with pytest.raises(UserError, match="maxComputeWorkGroupCount"):
        pack([cloth] * 3, limits=Limits(groups=2))
    assert pack([cloth], limits=Limits(invocations=48)).group_size == 32
    assert pack([cloth], limits=Limits(invocations=1024, shared_bytes=2048)).group_size == 64


@pytest.mark.long
def test_a_million_particles_become_a_cloth():
    cloth = sheet(1000, 1000, 0.01)
    assert len(cloth.positions) == 10**6
    packed = pack([cloth], limits=Limits(storage_bytes=1 << 27))
    assert packed.particles == 10**6


@pytest.mark.parametrize(("turn", "spins"), [(0.5, True), (0.99, True), (1.01, False), (2.0, False)])
def test_a_collider_spins_by_its_turn_unless_it_was_placed_anew(turn, spins):
    """Beyond a radian in the steps of a frame (`FASTEST_TURN`) the node was placed anew, and has no velocity at all."""
    after = np.eye(4)
    after[:3, :3] = [[np.cos(turn), 0, np.sin(turn)], [0, 1, 0], [-np.sin(turn), 0, np.cos(turn)]]
    after[:3, 3] = 0.1, 0.0, 0.0
    moved = Obstacle(0, "box", half=(1.0, 2.0, 3.0)).moved(np.eye(4), after, 0.05)
    assert np.allclose(moved.spin, (0.0, turn / 0.05, 0.0) if spins else 0.0)
    assert np.allclose(moved.velocity, (2.0, 0.0, 0.0) if spins else 0.0)
