"""The study torus-knot: every vertex half a unit from the curve, a closed surface, nothing computed twice."""

from __future__ import annotations

import math

import numpy as np
import pytest

import chapters
from backends.gl import api as gl
from chapters.ch05.studies.torus_knot import Settings, coefficient, matrices
from chapters.ch05.studies.torus_knot.knot import curve, indices, morphed, tube, turns_of
from tests.support.hazards import Signal, Use, Wait, find_hazards
from tests.support.kernel_calls import HOST_READ, barriers_told, events_of, gl_calls, owed, use, without_each

knots = pytest.mark.feature("compute/mesh-generator")
waits = pytest.mark.feature("compute/barriers")
only_vulkan = pytest.mark.parametrize("stage", ["vulkan"], indirect=True, scope="module")
only_gl = pytest.mark.parametrize("stage", ["gl"], indirect=True, scope="module")
WHICH = "5/torus-knot"
SIZE = (32, 24)
PAIRS = [(2, 3), (5, 8), (1, 1), (3, 7)]
CLOSE = 2e-5
"""Of positions up to 8.5 in single precision, sines by the driver: 40 roundings."""


def knot(p, q, t):
    """The curve, as books have it; t goes p times around."""
    s = q * t / p
    away = 5 + 3 * np.cos(s)
    return np.stack([away * np.cos(t), away * np.sin(t), 3 * np.sin(s)], axis=-1)


def mesh(stage, time=0.0, **settings):
    """Return positions and normals of a frame's mesh, float64, and its vertices as they are."""
    with stage.open(WHICH, SIZE, settings=Settings(**settings)) as renderer:
        renderer.render(chapters.view_of(renderer), time)
        found = renderer.mesh()
    return found[..., :3].astype(float), found[..., 4:7].astype(float), found


# --- the CPU's ---


@knots
@pytest.mark.parametrize(("p", "q"), PAIRS)
def test_the_derivative_on_the_cpu_is_that_of_the_curve(p, q):
    u, h = np.linspace(0.013, 0.987, 301), 1e-6
    points, along = curve(p, q, u)
    t = math.tau * p * u
    assert np.abs(points - knot(p, q, t)).max() < 1e-12
    assert np.abs(along - (knot(p, q, t + h) - knot(p, q, t - h)) / (2 * h)).max() < 1e-7


@knots
@pytest.mark.parametrize("grid", [(64, 32), (32, 64), (4, 4), (7, 5)])
def test_triangles_of_any_grid_make_a_closed_surface_that_looks_outwards(grid):
    along, around = grid
    triangles = indices(along, around)
    assert triangles.shape == (2 * (along - 1) * (around - 1), 3) and triangles.dtype == np.uint32
    assert {*triangles.ravel()} == {*range(along * around)}
    # With the last points put where the first ones are, each edge belongs to two triangles, once in each direction.
    i, j = triangles // around % (along - 1), triangles % around % (around - 1)
    edges = [
        (int(one), int(other))
        for corners in i * around + j
        for one, other in zip(corners, np.roll(corners, -1), strict=True)
    ]
    assert len({*edges}) == len(edges) and {(b, a) for a, b in edges} == {*edges}
    if along >= 32:
        positions, normals = (one.reshape(-1, 3) for one in tube(2, 3, turns_of(along), turns_of(around)))
        a, b, c = (positions[triangles[:, corner]] for corner in range(3))
        assert ((np.cross(b - a, c - a) * normals[triangles].sum(axis=1)).sum(axis=-1) > 0).all()


# --- the GPU's ---


@knots
@pytest.mark.parametrize(("p", "q"), PAIRS)
@pytest.mark.parametrize("grid", [(64, 32), (37, 9)])
def test_every_vertex_is_half_a_unit_from_the_curve_and_its_normal_points_there(stage, p, q, grid):
    positions, normals, found = mesh(stage, p1=p, q1=q, along=grid[0], around=grid[1], speed=0.0)
    assert positions.shape == (*grid, 3)
    t, h = math.tau * p * np.arange(grid[0]) / (grid[0] - 1), 1e-6
    points, way = knot(p, q, t)[:, None], (knot(p, q, t + h) - knot(p, q, t - h))[:, None]
    outward = positions - points
    assert np.abs(np.linalg.norm(outward, axis=-1) - 0.5).max() < CLOSE
    assert np.abs((outward * way).sum(axis=-1) / np.linalg.norm(way, axis=-1)).max() < CLOSE
    assert np.abs(np.linalg.norm(normals, axis=-1) - 1).max() < 1e-6
    assert np.abs(normals - outward / 0.5).max() < 2 * CLOSE
    # All around, in equal steps: the neighbours of a circle of n points are 2 r sin(pi / n) apart.
    steps = np.linalg.norm(np.diff(positions, axis=1), axis=-1)
    assert np.abs(steps - math.sin(math.pi / (grid[1] - 1))).max() < 2 * CLOSE
    u, v = np.meshgrid(turns_of(grid[0]), turns_of(grid[1]), indexing="ij")
    assert np.abs(found[..., 3] - u).max() < 1e-7 and np.abs(found[..., 7] - v).max() < 1e-7


@knots
def test_the_mesh_is_closed_to_the_bit_and_that_of_the_cpu(stage):
    positions, normals, _ = mesh(stage, morph=0.3, along=65, around=17, speed=0.0)
    for one in (positions, normals):
        assert (one[0] == one[-1]).all() and (one[:, 0] == one[:, -1]).all()
    expected = morphed((2, 3, 5, 8), np.float32(0.3), turns_of(65), turns_of(17))
    assert np.abs(positions - expected[0]).max() < CLOSE
    shortest = np.linalg.norm(0.7 * tube(2, 3, turns_of(65), turns_of(17))[1], axis=-1).min() - 0.3
    assert np.abs(normals - expected[1]).max() < CLOSE / shortest


@knots
@pytest.mark.parametrize("grid", [(64, 32), (33, 8)])
def test_without_and_with_all_of_the_second_knot_it_is_one_of_the_two(stage, grid):
    size = {"along": grid[0], "around": grid[1], "speed": 0.0}
    for morph, (p, q) in ((0.0, (2, 3)), (1.0, (5, 8))):
        alone = mesh(stage, p1=p, q1=q, p2=p, q2=q, **size)[2]
        assert (mesh(stage, morph=morph, **size)[2] == alone).all()
    between = mesh(stage, morph=0.5, **size)
    ends = [mesh(stage, morph=morph, **size) for morph in (0.0, 1.0)]
    assert np.abs(between[0] - (ends[0][0] + ends[1][0]) / 2).max() < CLOSE
    assert np.abs(np.linalg.norm(between[1], axis=-1) - 1).max() < 1e-6


def test_the_coefficient_goes_there_and_back():
    found = [coefficient(Settings(morph=0.25, speed=0.5), time) for time in (0, 1, 1.5, 2, 3.5, 4, 1e9)]
    assert found == [0.25, 0.75, 1.0, 0.75, 0.0, 0.25, 0.25]


# --- the picture ---


@knots
def test_the_surface_is_drawn_where_it_is_and_lit(stage):
    size, time = (160, 120), 0.7
    with stage.open(
        WHICH, size, settings=Settings(along=128, around=16), outputs=("color", "depth")
    ) as renderer:
        view = chapters.view_of(renderer)
        frame = renderer.render(view, time)
        color, depth, vertices = frame.image("color"), frame.image("depth"), renderer.mesh()
    view_from_object, clip_from_view = (
        matrices(view, time, size[0] / size[1]).astype(float).transpose(0, 2, 1)
    )
    flat = vertices.reshape(-1, 8).astype(float)
    clip = (
        np.concatenate([flat[:, :3], np.ones((len(flat), 1))], axis=1) @ view_from_object.T @ clip_from_view.T
    )
    x, y = ((clip[:, axis] / clip[:, 3] + 1) / 2 * size[axis] for axis in range(2))
    own = clip[:, 2] / clip[:, 3]
    # Nothing is nearer than the nearest vertex; where a vertex is that faces the camera, something as near was drawn.
    assert 0.98 * own.max() < depth.max() < 1.02 * own.max()
    seen = depth[y.astype(int), x.astype(int)]
    normals = flat[:, 4:7] @ view_from_object[:3, :3].T
    facing = normals[:, 2] > 0.6 * np.linalg.norm(normals, axis=-1)
    assert facing.mean() > 0.1 and (seen > 0.97 * own)[facing].mean() > 0.98
    covered = depth > 0
    assert 0.05 < covered.mean() < 0.6
    background = np.rint(255 * np.array([0.05, 0.05, 0.06]))
    assert (color[~covered] == background).all() and color[covered].max() > 200
    assert len(np.unique(color[covered], axis=0)) > 200


@knots
def test_nothing_is_dispatched_while_the_shape_stands_still_and_the_picture_is_the_same(stage):
    found = {}
    for skips in (True, False):
        still = Settings(morph=0.4, speed=0.0, along=64, around=8)
        with stage.open(WHICH, SIZE, settings=still) as renderer:
            view, found[skips] = chapters.view_of(renderer), []
            for time in (0.0, 0.5, 1.0):
                if not skips:
                    renderer._made_with = None
                frame = renderer.render(view, time)
                found[skips].append((frame.work["dispatches"], frame.image("color")))
    assert [one[0] for one in found[True]] == [1, 0, 0] and [one[0] for one in found[False]] == [1, 1, 1]
    assert all((one[1] == other[1]).all() for one, other in zip(found[True], found[False], strict=True))
    assert (found[True][0][1] != found[True][1][1]).any()  # it turns all the same
    with stage.open(WHICH, SIZE) as renderer:
        work = [renderer.render(view, time).work["dispatches"] for time in (0.0, 0.0, 0.5, 0.5, 1.0)]
    assert work == [1, 0, 1, 0, 1]


# --- who waits ---

USES = {
    "kernel": [use("kernel", "mesh", "compute storage_write", fresh=True)],
    "knot": [use("knot", "mesh", "vertex storage_read")],
}


@knots
@waits
@only_vulkan
def test_each_barrier_is_needed_and_none_is_missing(stage):
    with stage.open(WHICH, SIZE) as renderer:
        view = chapters.view_of(renderer)
        events = events_of(renderer, lambda number: renderer.render(view, 0.1 * number), USES)
    assert find_hazards(events, {}) == []
    own = [hazards for one, hazards in without_each(events) if "compute" in str(one)]
    assert len(own) == 2 and all(own)


@waits
@only_vulkan
def test_the_way_to_the_cpu_takes_two_barriers(stage):
    """The copy must see what was written, and the CPU what was copied; the submission's fence says when."""
    with stage.open(WHICH, SIZE) as renderer:
        renderer.render(chapters.view_of(renderer))
        to_copy, to_host = barriers_told(stage.device, renderer.mesh, ["mesh", "copied"])
    events = [
        *USES["kernel"],
        to_copy,
        use("the copy", "mesh", "copy copy_read"),
        use("the copy", "copied", "copy copy_write", fresh=True),
        to_host,
        Signal("fence"),
        Wait("fence", queue="host"),
        Use("the CPU", "copied", HOST_READ, queue="host"),
    ]
    assert find_hazards(events, {}) == []
    for left_out in (to_copy, to_host):
        assert find_hazards([one for one in events if one is not left_out], {})


@waits
@only_gl
def test_opengl_is_told_before_and_behind(stage):
    bit = gl.GL_SHADER_STORAGE_BARRIER_BIT
    reads = {"glDrawElementsBaseVertex": bit}
    with stage.open(WHICH, SIZE) as renderer:
        view = chapters.view_of(renderer)
        calls = gl_calls(stage.device, renderer, lambda number: renderer.render(view, 0.1 * number))
    assert owed(calls, reads, bit) == []
    told = [place for place, one in enumerate(calls) if one == ("glMemoryBarrier", bit)]
    for first in (2, 3):  # of the second frame: before its kernel, and behind it
        assert owed([one for place, one in enumerate(calls) if place != told[first]], reads, bit)


@waits
@only_gl
def test_opengl_copies_behind_the_barrier_for_copies(stage):
    with stage.open(WHICH, SIZE) as renderer:
        renderer.render(chapters.view_of(renderer))
        calls = gl_calls(stage.device, renderer, lambda number: renderer.mesh(), 1)
    assert calls[:2] == [
        ("glMemoryBarrier", gl.GL_BUFFER_UPDATE_BARRIER_BIT),
        ("glCopyNamedBufferSubData", calls[1][1]),
    ]


@knots
@pytest.mark.parametrize(
    ("set_", "said"),
    [
        ("p1=4 q1=6", "2 divides both, and the curve closes too early; try p1=2 and q1=3."),
        ("p2=10", "p2=10 and q2=8 are no knot"),
    ],
)
def test_what_is_no_knot_is_one_sentence(strata, set_, said):
    words = [word for one in set_.split() for word in ("--set", one)]
    code, _, err = strata("run", WHICH, "--size", "8x8", "--headless", *words)
    assert code == 2 and said in err and err.count("\n") == 1, err
