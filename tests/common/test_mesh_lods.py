"""Levels of detail against their promises: counts, ranges, distances; sampled by other points than theirs."""

from __future__ import annotations

import sys
from dataclasses import replace

import numpy as np
import pytest

from common.errors import UserError
from common.mesh import lods
from common.mesh.lods import lod_chain, simplified
from common.mesh.metrics import hausdorff
from common.mesh.pools import mesh_indices, mesh_positions
from common.scene import Deformation, Scene
from tests.support.meshes import grid, scene_of


@pytest.fixture
def scene() -> Scene:
    return scene_of(grid(3, 3), grid(24, 24, height=0.15), drawn=(1,))


@pytest.mark.feature("mesh/simplify")
@pytest.mark.parametrize("ratio", [0.0, 0.2, 0.7, 1.0])
@pytest.mark.needs("meshoptimizer")
def test_simplifying_ends_at_the_ratio_or_the_error(scene, ratio):
    before = scene.indices.tobytes()
    indices, error = simplified(scene, 1, ratio)
    assert scene.indices.tobytes() == before
    assert len(indices) % 3 == 0 and indices.max() < scene.meshes["vertex_count"][1]
    assert error <= 1e-2
    if ratio == 0:
        # The target cannot be reached, so the error stops it: the next collapse would pass the bound.
        assert len(indices) > 0 and error > 0.005
    else:
        assert len(indices) <= ratio * 3456
        assert len(indices) > 0.9 * ratio * 3456


def corner_vectors(positions: np.ndarray, indices: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the corners of each triangle, (T, 3) float64 each."""
    a, b, c = positions.astype(np.float64)[indices.reshape(-1, 3)].swapaxes(0, 1)
    return a, b, c


def farthest(places: np.ndarray, positions: np.ndarray, indices: np.ndarray) -> float:
    """Return how far the farthest of some places (P, 3) is from a surface: each of them from each triangle's points.

    The nearest point of a triangle is inside it, where the foot of the plumb line has no negative weight, or else the
    nearest of its edges.
    """
    a, b, c = corner_vectors(positions, indices)
    greatest = 0.0
    for place in places.astype(np.float64):
        near = np.inf
        for p, q in ((a, b), (b, c), (c, a)):
            along = q - p
            part = np.clip(((place - p) * along).sum(-1) / (along**2).sum(-1), 0, 1)
            near = min(near, np.linalg.norm(p + part[:, None] * along - place, axis=1).min())
        normal = np.cross(b - a, c - a)
        doubled = (normal**2).sum(-1)
        weights = [
            (np.cross(q - p, place - p) * normal).sum(-1) / doubled for p, q in ((a, b), (b, c), (c, a))
        ]
        inside = np.min(weights, axis=0) >= 0
        heights = np.abs(((place - a) * normal).sum(-1))[inside] / np.sqrt(doubled[inside])
        greatest = max(greatest, min(near, heights.min(initial=np.inf)))
    return greatest


@pytest.mark.feature("mesh/simplify")
@pytest.mark.parametrize("ratio", [0.0, 0.2, 0.5])
@pytest.mark.needs("meshoptimizer")
def test_the_surface_stays_near_every_vertex_that_is_left_out(scene, ratio):
    """By the distance of each vertex from each triangle, not by what the simplifier says of itself."""
    positions = mesh_positions(scene, 1)
    indices, error = simplified(scene, 1, ratio)
    # The estimate is an average over the planes around: within twice as much is what holds, 1e-2 of the extent 1.
    apart = farthest(positions, positions, indices)
    assert 0 < apart <= 2e-2 and apart > 0.5 * error
    a, b, c = corner_vectors(positions, indices)
    flat = np.cross(b - a, c - a)[:, 2] / 2
    assert flat.min() > -1e-7, "no triangle is turned over"
    assert flat.sum() == pytest.approx(1.0, abs=1e-6), "the unit square is covered once"


@pytest.mark.feature("mesh/simplify")
@pytest.mark.needs("meshoptimizer")
def test_a_flat_square_ends_as_two_triangles_and_a_missing_one_would_be_seen():
    positions, indices = grid(8, 12, height=0)
    found, error = simplified(scene_of((positions, indices)), 0, ratio=0.0)
    assert len(found) == 6 and error < 1e-6
    corners = {tuple(one) for one in positions[found].tolist()}
    assert corners == {(0, 0, 0), (1, 0, 0), (0, 1, 0), (1, 1, 0)}
    assert farthest(positions, positions, found) < 1e-7
    assert farthest(positions, positions, found[:3]) > 0.5


@pytest.mark.feature("mesh/lod-chain")
@pytest.mark.needs("meshoptimizer")
def test_levels_get_smaller_and_stay_near(scene):
    levels = lod_chain(scene, 1, further=7, samples=300)
    positions, original = mesh_positions(scene, 1), mesh_indices(scene, 1)
    assert np.array_equal(levels[0].indices, original) and 3 <= len(levels) <= 8
    counts = [len(level.indices) for level in levels]
    assert counts == sorted(counts, reverse=True) and 1600 < counts[1] <= 1728
    for level in levels[1:]:
        assert len(level.indices) % 3 == 0 and level.indices.max() < len(positions)
        apart = hausdorff(positions, original, positions, level.indices, samples=800, seed=77)
        assert apart == pytest.approx(level.distance, rel=0.5)  # the extent of the mesh is 1
        if not level.sloppy:
            assert apart <= 0.02
    assert not levels[1].sloppy


@pytest.mark.needs("meshoptimizer")
def test_a_chain_is_as_long_as_was_asked_for(scene):
    for further in (0, 1):
        assert len(lod_chain(scene, 1, further, samples=100)) == 1 + further


@pytest.mark.feature("mesh/lod-chain")
@pytest.mark.needs("meshoptimizer")
def test_small_meshes_have_one_level_and_the_count_is_tested_before_it_is_halved(scene):
    assert len(lod_chain(scene, 0)) == 1
    flat = grid(10, 18, height=0)
    for count, levels in ((1023, 1), (1026, 2)):
        assert len(lod_chain(scene_of((flat[0], flat[1][:count])), 0)) == levels


@pytest.mark.needs("meshoptimizer")
def test_a_bound_is_kept_where_quadrics_are_wrong(scene):
    # The simplifier's own estimate stays below the bound in any case, and the distance would be twice that.
    bound = 0.006
    levels = lod_chain(scene, 1, distance=bound, samples=300)
    positions, original = mesh_positions(scene, 1), mesh_indices(scene, 1)
    true = [hausdorff(positions, original, positions, each.indices, samples=800) for each in levels]
    assert all(apart <= bound or level.sloppy for apart, level in zip(true, levels, strict=True))
    assert any(not level.sloppy for level in levels[1:])


@pytest.mark.needs("meshoptimizer")
def test_tangents_of_every_triangle_are_no_seams(scene):
    positions, indices = grid(20, 20)
    apart = scene_of((positions[indices], np.arange(len(indices), dtype=np.uint32)))
    turned = apart.tangents.copy()
    turned[:, :3] += np.random.default_rng(0).normal(size=(len(turned), 3)).astype(np.float32) * 0.1
    counts = [
        len(simplified(replace(apart, tangents=tangents), 0)[0]) for tangents in (apart.tangents, turned)
    ]
    assert counts[0] == counts[1] <= 480


@pytest.mark.feature("mesh/simplify")
@pytest.mark.needs("meshoptimizer")
def test_what_a_morph_target_moves_apart_is_not_simplified_as_one_surface():
    """Two flat squares meet at rest, each with its own vertices; a morph target lifts one."""
    (left, cells), right = grid(8, 12, height=0), np.array((1, 0, 0), np.float32)
    squares = (np.concatenate([left, left + right]), np.concatenate([cells, cells + np.uint32(len(left))]))
    lifted = np.zeros((1, len(squares[0]), 3), np.float32)
    lifted[:, len(left) :, 2] = 1.0
    still = scene_of(grid(3, 3, height=0), squares, drawn=(1,))
    moving = replace(still, deformations=[Deformation(mesh=1, node=0, morph_positions=lifted)])

    def in_both(scene: Scene) -> int:
        """Return how many triangles have vertices of both squares."""
        of_right = simplified(scene, 1, ratio=0.0)[0].reshape(-1, 3) >= len(left)
        assert len(of_right) < 12  # of 384
        return int((of_right.any(axis=1) & ~of_right.all(axis=1)).sum())

    assert in_both(moving) == 0
    assert in_both(still) > 0, "without the target the squares are one rectangle"
    assert np.array_equal(simplified(moving, 0)[0], simplified(still, 0)[0]), "mesh 0 has no deformation"


@pytest.mark.feature("mesh/lod-chain")
def test_wrong_calls_and_a_missing_package(monkeypatch):
    one = scene_of(grid(2, 2))
    with pytest.raises(ValueError, match="0 to 7 further levels, not 8"):
        lod_chain(one, 0, further=8)
    with pytest.raises(ValueError, match=r"not 1\.5"):
        simplified(one, 0, 1.5)
    monkeypatch.setitem(sys.modules, "meshoptimizer", None)
    for call in (simplified, lod_chain):
        with pytest.raises(
            UserError, match=r"^(simplifying a mesh|making levels of detail) needs the package mesh"
        ):
            call(one, 0)


@pytest.mark.needs("meshoptimizer")
@pytest.mark.parametrize(("kept", "levels"), [(0.5, 3), (0.9, 3), (0.92, 1), (1.0, 1)])
def test_a_chain_ends_where_a_level_gains_less_than_a_tenth(scene, monkeypatch, kept, levels):
    """Of the level before: 0.9 of it times 1.1 is below 1, and 0.92 of it times 1.1 is above."""

    def simplify(library, positions, indices, target, error, sloppy=False):
        count = int(kept * 2 * target) // 3 * 3
        return indices[:count], 0.0

    monkeypatch.setattr(lods, "_simplify", simplify)
    monkeypatch.setattr(lods, "surely_within", lambda *arguments: True)
    monkeypatch.setattr(lods, "hausdorff", lambda *arguments: 0.0)
    chain = lod_chain(scene, 1, further=2)
    assert len(chain) == levels
