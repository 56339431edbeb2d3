"""Slices of depth and places of froxels: round trips in float64, and `shaders/slices.glsl` on both backends."""

from __future__ import annotations

import numpy as np
import pytest

from common.numerics.transforms import orthographic, perspective, pose_looking_at
from tests.support.either import evaluate
from tests.twins.fog_grid import Grid

SLICES = ["slices.glsl"]
ULP = 2.0**-24
NEAR, FAR, COUNT = 0.1, 100.0, 128
froxels = pytest.mark.feature("fog/froxel-volume")

LENSES = {
    "perspective": perspective(1.0, 1.6, NEAR),
    "narrow": perspective(0.05, 0.5, 2.0),
    "wide": perspective(2.6, 2.0, 1e-3),
    "orthographic": orthographic(3.0, 1.5, 0.05, 120.0),
}
every_lens = pytest.mark.parametrize("name", LENSES)


def grid_of(name, size=(128, 128, 128), jitter=(0.0, 0.0), eye=(3.0, 1.0, -2.0)):
    lens = LENSES[name].copy()
    lens[:2] += np.outer(jitter, lens[3])
    pose = pose_looking_at(eye, np.add(eye, (1.0, -0.3, 0.7)))
    return Grid(size, NEAR, FAR, lens, pose)


@froxels
@every_lens
def test_places_and_depths_go_there_and_back(name):
    """In float64, at random places of the 128^3 grid and at centres; less than 1e-6 of a slice off."""
    grid = grid_of(name, jitter=(0.013, -0.021))
    uvw = np.random.default_rng(1).uniform(0, 1, (3000, 3))
    uvw = np.concatenate([uvw, grid.centers()[::17, ::31, ::29].reshape(-1, 3)])
    back = grid.uvw_from_world(grid.world_from_uvw(uvw))
    assert np.abs(back - uvw).max() * 128 < 1e-6
    assert np.abs(grid.w(grid.depth(uvw[:, 2])) - uvw[:, 2]).max() * 128 < 1e-10


@froxels
def test_slices_keep_a_ratio_and_the_first_begins_at_the_eye():
    edges = grid_of("perspective").edges()
    assert len(edges) == COUNT + 1 and edges[0] == 0.0
    assert edges[-1] == pytest.approx(FAR, rel=1e-14)
    np.testing.assert_allclose(edges[2:] / edges[1:-1], 1000 ** (1 / 128), rtol=1e-13)
    # 0.1 * 1000^(1/128) from the eye; then 0.1 * 1000^(1/128) * (1000^(1/128) - 1), and so on.
    np.testing.assert_allclose(np.diff(edges)[[0, 1, -1]], [0.10554, 0.0058524, 5.2536], rtol=1e-4)


@froxels
@every_lens
def test_a_froxel_s_place_is_that_of_the_projection(name):
    """Through the matrices as they are used elsewhere: to clip space, divided by w."""
    grid = grid_of(name, jitter=(0.013, -0.021))
    uvw = np.random.default_rng(2).uniform(0, 1, (500, 3))
    points = np.column_stack([grid.world_from_uvw(uvw), np.ones(500)])
    view = points @ np.linalg.inv(grid.world_from_view).T
    clip = view @ grid.clip_from_view.T
    np.testing.assert_allclose(clip[:, :2] / clip[:, 3:] * 0.5 + 0.5, uvw[:, :2], atol=1e-9)
    np.testing.assert_allclose(-view[:, 2], grid.depth(uvw[:, 2]), rtol=1e-11)
    start, direction = grid.rays(uvw[:, :2])
    along = ((points[:, :3] - start) * direction).sum(axis=1)
    np.testing.assert_allclose(start + along[:, None] * direction, points[:, :3], atol=1e-9 * FAR)
    np.testing.assert_allclose(along, grid.stretch(uvw[:, :2]) * grid.depth(uvw[:, 2]), rtol=1e-9)


DEPTHS = """
    depth = slice_depth(w, 0.1, octaves);
    back = slice_coordinate(depth, 0.1, octaves);
"""


@froxels
@pytest.mark.parametrize("far", [1.0, 100.0, 1e4])
def test_a_shader_s_depths_go_there_and_back(either_device, far):
    """exp2(x) may be off by 3 + 2 |x| units in the last place, log2 by three, or 2^-21 near 1; two products round.

    So a depth is off by (3 + 2 octaves + 3 octaves) units and a coordinate by what a relative error is in octaves.
    """
    octaves = np.log2(far / 0.1)
    w = np.float32(np.concatenate([[0.0, 1.0], np.random.default_rng(3).uniform(0, 1, 5000)]))
    given = {"w": w, "octaves": np.full_like(w, octaves)}
    got = evaluate(either_device, SLICES, DEPTHS, given, {"depth": "float", "back": "float"})
    exact = np.float64(np.float32(0.1)) * 2.0 ** (w * np.float64(np.float32(octaves)))
    relative = (4 + 5 * octaves) * 2 * ULP
    assert (np.abs(got["depth"] - exact) <= relative * exact).all()
    bound = (relative / np.log(2) + 2.0**-21 + 8 * octaves * ULP) / octaves
    assert np.abs(got["back"] - w).max() <= bound
    assert 128 * bound < 1e-3


@froxels
def test_depths_without_a_slice(either_device):
    depth = np.float32([0.0, -1.0, 1e-30, 0.05, 0.1, 100.0, 1e5, np.inf])
    octaves = float(np.log2(1000.0))
    body = f"w = slice_coordinate(depth, 0.1, {octaves!r});"
    w = evaluate(either_device, SLICES, body, {"depth": depth}, {"w": "float"})["w"]
    assert w[:3].tolist() == [-1.0, -1.0, -1.0]
    assert w[3] == pytest.approx(-1 / octaves, abs=1e-5)
    assert w[4:6] == pytest.approx([0.0, 1.0], abs=1e-6)
    assert w[6] > 1.9 and w[7] == np.inf


@froxels
def test_edges_of_slices(either_device):
    index = np.arange(COUNT + 1, dtype=np.uint32)
    octaves = float(np.log2(1000.0))
    body = f"begin = slice_begin(index, {COUNT}u, 0.1, {octaves!r});"
    got = evaluate(either_device, SLICES, body, {"index": index}, {"begin": "float"})["begin"]
    np.testing.assert_allclose(got, grid_of("perspective").edges(), rtol=(4 + 5 * octaves) * 2 * ULP)
    assert got[0] == 0.0 and (np.diff(got) > 0).all()


@froxels
@pytest.mark.parametrize("part", [0.0, 0.25, 0.5, 1.0])
def test_samples_within_slices(either_device, part):
    index = np.arange(COUNT, dtype=np.uint32)
    octaves = float(np.log2(1000.0))
    body = f"depth = slice_sample(index, {part!r}, {COUNT}u, 0.1, {octaves!r});"
    got = evaluate(either_device, SLICES, body, {"index": index}, {"depth": "float"})["depth"]
    grid = grid_of("perspective")
    np.testing.assert_allclose(got, grid.depths(part), rtol=(5 + 5 * octaves) * 2 * ULP)
    edges = grid.edges()
    near = (5 + 5 * octaves) * 2 * ULP * edges[1:]
    assert (got >= edges[:-1] - near).all() and (got <= edges[1:] + near).all()


@froxels
@every_lens
def test_a_shader_s_places_are_those_of_float64_and_go_there_and_back(either_device, name):
    """Less than 1e-4 of a cell of the 128^3 grid off after view space and back: a few ULP of the picture."""
    grid = grid_of(name, jitter=(0.013, -0.021))
    numbers = ", ".join(repr(float(number)) for number in np.float32(grid.clip_from_view).T.reshape(-1))
    uvw = np.float32(np.random.default_rng(5).uniform(0, 1, (4000, 3)))
    uvw[:8] = np.indices((2, 2, 2)).reshape(3, -1).T
    depth = np.float32(grid.depth(uvw[:, 2]))
    body = f"""
        const mat4 lens = mat4({numbers});
        view = view_from_volume(uv, depth, lens);
        back = volume_from_view(view, lens);
        stretch = ray_stretch(uv, lens);
    """
    given = {"uv": np.ascontiguousarray(uvw[:, :2]), "depth": depth}
    outputs = {"view": "vec3", "back": "vec3", "stretch": "float"}
    got = evaluate(either_device, SLICES, body, given, outputs)
    rounded = Grid(grid.size, NEAR, FAR, np.float64(np.float32(grid.clip_from_view)), grid.world_from_view)
    exact = rounded.view_from_uvw(uvw, depth.astype(np.float64))
    # Of a place: 2 uv - 1, two products, a sum and a division by the scale, each of at most the picture's half width.
    size = depth * np.abs(grid.clip_from_view[3, 2]) + grid.clip_from_view[3, 3]
    for row in (0, 1):
        wide = 1.1 * size / abs(grid.clip_from_view[row, row])
        assert (np.abs(got["view"][:, row] - exact[:, row]) <= 10 * ULP * wide).all()
    assert np.array_equal(got["view"][:, 2], -depth)
    assert np.abs(got["back"][:, :2] - uvw[:, :2]).max() * 128 < 1e-4
    assert np.array_equal(got["back"][:, 2], depth)
    # Two differences of neighbouring points: of 1 and 2 m, or of 0 and 1 m, here.
    assert (np.abs(got["stretch"] / rounded.stretch(uvw[:, :2]) - 1) < 40 * ULP).all()


@froxels
def test_what_lies_behind_an_eye_is_outside(either_device):
    """Its uv may look right, but its depth is negative."""
    grid = grid_of("perspective")
    view = np.array([(0.1, 0.2, 3.0), (0.0, 0.0, 0.0), (0.1, -0.1, -3.0)])
    world = view @ grid.world_from_view[:3, :3].T + grid.world_from_view[:3, 3]
    with np.errstate(divide="ignore", invalid="ignore"):
        uvw = grid.uvw_from_world(world)
    inside = ((uvw >= 0) & (uvw <= 1)).all(axis=1)
    assert inside.tolist() == [False, False, True]
    numbers = ", ".join(repr(float(number)) for number in np.float32(grid.clip_from_view).T.reshape(-1))
    body = f"""
        vec3 there = volume_from_view(view, mat4({numbers}));
        w = slice_coordinate(there.z, 0.1, 9.96578428466);
    """
    w = evaluate(either_device, SLICES, body, {"view": np.float32(view)}, {"w": "float"})["w"]
    assert ((w >= 0) & (w <= 1)).tolist() == [False, False, True]
