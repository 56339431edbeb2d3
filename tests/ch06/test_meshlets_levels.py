"""Levels of detail as meshes of a view: ranges, vertices and errors against the levels themselves."""

from __future__ import annotations

import sys
from dataclasses import replace

import numpy as np
import pytest

from chapters.ch06.meshlets.build import build_meshlets
from chapters.ch06.meshlets.chains import kept_chains
from chapters.ch06.meshlets.lods import MAX_LEVELS, SURE, with_levels
from chapters.ch06.meshlets.model import may_be_cut
from chapters.ch06.meshlets.scene import keep_no_levels, levels_of
from chapters.ch06.scene.pages import PAGE_BYTES
from common.errors import UserError
from common.mesh.lods import Level
from common.mesh.metrics import hausdorff
from common.scene import Deformation, Instances, Material
from tests.support.meshes import grid, scene_of
from tests.support.meshlet_surfaces import placed, triangles_of

GRID = grid(26, 26, height=0.15)


def positions_of(scene, mesh):
    row = scene.meshes[mesh]
    return scene.positions[row["first_vertex"] : row["first_vertex"] + row["vertex_count"]]


@pytest.mark.needs("meshoptimizer")
def test_levels_are_further_meshes_over_the_same_vertices():
    scene = scene_of(grid(3, 3), GRID, drawn=(1,))
    before = scene.indices.tobytes()
    levels = with_levels(scene)
    view, number = levels.scene, int(levels.counts[1])
    assert (
        scene.indices.tobytes() == before == view.indices[: len(scene.indices)].tobytes()
    )  # the last mesh has them
    assert (view.meshes[:2] == scene.meshes).all() and view.instances is scene.instances
    assert view.positions is scene.positions and (view.origin == scene.origin).all()
    assert levels.counts.tolist() == [1, number] and 2 < number < MAX_LEVELS
    assert levels.meshes.shape == levels.errors.shape == (2, 8) and len(view.meshes) == 1 + number
    assert levels.meshes[0].tolist() == [0] * 8 and not levels.errors[0].any()
    assert levels.meshes[1].tolist() == [1, *range(2, 1 + number), *[number] * (8 - number)]
    assert view.mesh_names[2:4] == ["mesh 1 level 1", "mesh 1 level 2"]
    counts = view.meshes["index_count"][levels.meshes[1, :number]].astype(int)
    assert (counts[1:] <= 0.6 * counts[:-1]).all() and (counts % 3 == 0).all()
    for name in ("first_vertex", "vertex_count", "material", "bounds_min", "bounds_max"):
        assert (view.meshes[name][2:] == scene.meshes[name][1]).all()
    ends = view.meshes["first_index"].astype(int) + view.meshes["index_count"]
    assert (view.meshes["first_index"][1:] == ends[:-1]).all() and ends[-1] == len(view.indices)
    known = {
        tuple(place) for place in positions_of(scene, 1)[triangles_of(scene, 1, scene.indices)].reshape(-1, 3)
    }
    for mesh in range(2, len(view.meshes)):
        used = positions_of(view, mesh)[triangles_of(view, mesh, view.indices)].reshape(-1, 3)
        assert {tuple(place) for place in used} <= known


@pytest.mark.needs("meshoptimizer")
def test_errors_are_lengths_of_the_object_and_never_fall():
    large, small = (with_levels(scene_of(placed(GRID, scale))) for scale in (64.0, 0.25))
    assert (large.counts == small.counts).all()
    assert large.errors == pytest.approx(256 * small.errors, rel=1e-5)
    errors, number = large.errors[0], int(large.counts[0])
    assert errors[0] == 0 and (np.diff(errors) >= 0).all() and (errors[number:] == errors[number - 1]).all()
    assert errors[1] > 0 and errors[number - 1] <= SURE * 0.02 * 64 * (1 + 1e-6)
    view = large.scene
    for level in range(1, number):
        mesh = int(large.meshes[0, level])
        surfaces = (triangles_of(view, row, view.indices).reshape(-1) for row in (0, mesh))
        a, b = (part for part in surfaces)
        apart = hausdorff(view.positions, a, view.positions, b, 300, 99)
        assert 1.5 * apart <= errors[level] <= 2.6 * apart  # other samples than its own, and twice as far


def test_meshes_with_level_0_alone(monkeypatch):
    """Deforming, blended and small meshes; meshes of equal geometry share the indices of their levels."""
    asked = []

    def chain(scene, mesh, further):
        asked.append(mesh)
        own = triangles_of(scene, mesh, scene.indices).reshape(-1)
        return [Level(own, 0, 0), Level(own[:600], 0, 0.02), Level(own[:90], 0, 0.01)]

    monkeypatch.setattr("chapters.ch06.meshlets.chains.lod_chain", chain)
    monkeypatch.setattr("chapters.ch06.meshlets.chains.cache_dir", lambda name: None)
    kinds = (Material(), Material(alpha_mode="blend"))
    scene = scene_of(GRID, GRID, GRID, grid(9, 9), GRID, kinds=kinds, materials=(0, 1, 0, 0, 0))
    for name in ("first_vertex", "first_index"):
        scene.meshes[name][4] = scene.meshes[name][0]
    scene.deformations.append(Deformation(2, 0))
    levels = with_levels(scene)
    assert asked == [0] and levels.counts.tolist() == [3, 1, 1, 1, 3]
    view = levels.scene
    assert levels.meshes[:, :4].tolist() == [[0, 5, 6, 6], *[[n] * 4 for n in (1, 2, 3)], [4, 7, 8, 8]]
    assert len(view.indices) == len(scene.indices) + 690
    assert (view.meshes["first_index"][[5, 6]] == view.meshes["first_index"][[7, 8]]).all()
    assert levels.errors[0, :3].tolist() == pytest.approx([0, 0.04, 0.04])  # twice; the longest side is 1
    # The views of levels are cut into meshlets as any scene: what fits into one takes the classic path.
    ranges = build_meshlets(view).ranges[:, 1] > 0
    assert ranges.tolist() == [True, False, False, True, True, True, False, True, False]


def test_without_the_package_it_is_one_sentence(monkeypatch):
    monkeypatch.setitem(sys.modules, "meshoptimizer", None)
    monkeypatch.setattr("chapters.ch06.meshlets.chains.cache_dir", lambda name: None)
    with pytest.raises(UserError, match=r"^making levels of detail needs the package meshoptimizer"):
        with_levels(scene_of(GRID))
    assert not with_levels(scene_of(grid(2, 2))).coarser  # nothing has to be made


@pytest.fixture
def made(monkeypatch, tmp_path):
    """Count the chains that are made; they are kept in a folder of the test's own."""
    asked = []

    def chain(scene, mesh, further):
        asked.append(mesh)
        own = triangles_of(scene, mesh, scene.indices).reshape(-1)
        return [Level(own, 0, 0), *(Level(own[: 90 * (3 - n)], 0, 0.01 * n) for n in range(1, 1 + mesh))]

    monkeypatch.setenv("STRATA_CACHE", str(tmp_path))
    monkeypatch.setattr("chapters.ch06.meshlets.chains.lod_chain", chain)
    return asked


def same_chains(one, other):
    return len(one) == len(other) and all(
        len(a) == len(b)
        and all(x.tobytes() == y.tobytes() and d == e for (x, d), (y, e) in zip(a, b, strict=True))
        for a, b in zip(one, other, strict=True)
    )


def test_chains_are_read_the_second_time(made, tmp_path):
    scene = scene_of(GRID, GRID, GRID)
    first = kept_chains(scene, [0, 1, 2])
    assert [len(chain) for chain in first] == [0, 1, 2] and made == [0, 1, 2]
    assert same_chains(kept_chains(scene, [0, 1, 2]), first) and made == [0, 1, 2]
    assert kept_chains(scene, []) == []
    (file,) = (tmp_path / "levels").glob("*.blob")
    file.write_bytes(file.read_bytes()[:-40])  # damaged: made again, and kept again
    assert same_chains(kept_chains(scene, [0, 1, 2]), first) and made == [0, 1, 2] * 2
    assert same_chains(kept_chains(scene, [0, 1, 2]), first) and made == [0, 1, 2] * 2


def test_chains_of_another_geometry_are_not_those_that_are_kept(made):
    scene = scene_of(GRID, GRID)
    kept_chains(scene, [1])
    for name in ("positions", "uv0", "indices"):
        other = scene_of(GRID, GRID)
        changed = getattr(other, name).copy()
        changed[:3] = changed[[1, 2, 0]]
        setattr(other, name, changed)
        before = len(made)
        kept_chains(other, [1])
        assert len(made) == before + 1, name


def test_without_a_place_to_keep_them_chains_are_made_each_time(made, monkeypatch):
    scene = scene_of(GRID, GRID)
    monkeypatch.setattr("chapters.ch06.meshlets.chains.cache_dir", lambda name: None)
    assert same_chains(kept_chains(scene, [1]), kept_chains(scene, [1])) and made == [1, 1]


def test_a_scene_without_meshes_has_no_levels():
    empty = scene_of(GRID)
    empty = replace(
        empty, meshes=empty.meshes[:0], mesh_names=[], instances=Instances(*np.zeros((2, 0), np.int32))
    )
    levels = with_levels(empty)
    assert not levels.coarser and levels.meshes.shape == (0, MAX_LEVELS)


def test_levels_of_a_scene_without_a_cache_are_kept_nowhere(made, tmp_path):
    for number, unkept in enumerate((False, True)):
        scene = scene_of(GRID, placed(GRID, 2.0 + number))
        if unkept:
            keep_no_levels(scene)
        assert levels_of(scene) is levels_of(scene)
        assert len([*(tmp_path / "levels").glob("*.blob")]) == 1


def test_a_mesh_that_is_too_large_to_be_drawn_is_not_cut():
    """It is refused when it is uploaded, and cutting it would take a minute before that."""
    scene = scene_of(GRID, GRID)
    assert may_be_cut(scene).tolist() == [True, True]
    scene.meshes["index_count"][1] = PAGE_BYTES // 4 + 3
    assert may_be_cut(scene).tolist() == [True, False]
