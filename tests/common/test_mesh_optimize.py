"""Meshes in a better order draw the same triangles; the scene that they come from stays as it was."""

from __future__ import annotations

import sys
from dataclasses import fields, replace

import numpy as np
import pytest

from common.errors import UserError
from common.mesh.metrics import cache_use
from common.mesh.optimize import PASSES, optimized
from common.mesh.pools import ATTRIBUTES, mesh_bounds, mesh_indices, mesh_positions
from common.scene import Change, Deformation, Instances, Material, Scene, TextureRef
from tests.support.meshes import grid, scene_of, shuffled

OWN = ("remap", "fetch")
"""Passes that need no package."""


def corners(scene: Scene, mesh: int) -> list[bytes]:
    """Return every triangle of a mesh as bytes of all attributes, from its smallest corner on, sorted."""
    first = int(scene.meshes["first_vertex"][mesh])
    places = first + mesh_indices(scene, mesh).astype(int)
    present = [values for name in ATTRIBUTES if (values := getattr(scene, name)) is not None]
    rows = np.concatenate([values[places] for values in present], axis=1)
    triangles = [[row.tobytes() for row in three] for three in rows.reshape(-1, 3, rows.shape[1])]
    return sorted(b"".join(min((t[i:] + t[:i]) for i in range(3))) for t in triangles)


def three_meshes() -> Scene:
    """Meshes 0 and 2 share vertices; 0 and 1 have their triangles in random order and a vertex per corner."""
    scene = scene_of(shuffled(grid(12, 15)), shuffled(grid(9, 9, seed=2)), drawn=(0,))
    meshes = np.concatenate([scene.meshes, scene.meshes[:1]])
    meshes["index_count"][2] = 90
    return replace(scene, meshes=meshes, mesh_names=["a", "b", "c"])


@pytest.mark.feature("mesh/optimize")
@pytest.mark.parametrize("passes", [OWN, pytest.param(PASSES, marks=pytest.mark.needs("meshoptimizer"))])
def test_triangles_stay_and_equal_vertices_become_one(passes):
    scene = three_meshes()
    before = {each.name: getattr(scene, each.name) for each in fields(scene)}
    bits = [getattr(scene, name).tobytes() for name in ("positions", "normals", "indices", "meshes")]
    result = optimized(scene, passes)
    assert [getattr(scene, name).tobytes() for name in ("positions", "normals", "indices", "meshes")] == bits
    assert all(getattr(scene, name) is value for name, value in before.items())
    for mesh in range(3):
        assert corners(result, mesh) == corners(scene, mesh)
        old, new = (cache_use(mesh_indices(each, mesh)) for each in (scene, result))
        assert new.misses <= old.misses
    assert len(result.positions) == 13 * 16 + 10 * 10  # the points of the grids; the unused vertices are gone
    assert result.meshes["vertex_count"].tolist() == [208, 100, 208]
    assert result.meshes["first_vertex"][0] == result.meshes["first_vertex"][2]
    if passes == PASSES:
        assert cache_use(mesh_indices(result, 0)).acmr < 0.8  # in random order 2.6


@pytest.mark.feature("mesh/optimize")
def test_vertices_are_numbered_by_first_use():
    result = optimized(three_meshes(), OWN)
    for mesh in (0, 1):
        indices = mesh_indices(result, mesh)
        _, first = np.unique(indices, return_index=True)
        assert (np.diff(first) > 0).all() and indices[0] == 0


def test_vertices_that_differ_in_anything_stay_two():
    scene = scene_of(grid(1, 1))
    twice = {name: np.concatenate([v, v]) for name in ATTRIBUTES if (v := getattr(scene, name)) is not None}
    meshes = scene.meshes.copy()
    meshes["vertex_count"], meshes["index_count"] = 8, 12
    indices = np.concatenate([scene.indices, scene.indices + np.uint32(4)])
    double = replace(scene, **twice, indices=indices, meshes=meshes)
    assert len(optimized(double, OWN).positions) == 4
    for name in twice:
        changed = twice[name].copy()
        changed[5, 1] += 0.25
        assert len(optimized(replace(double, **{name: changed}), OWN).positions) == 5
    joints = np.zeros((8, 4), np.int32)
    joints[6] = 1
    skin = Deformation(
        mesh=0,
        node=0,
        joints=np.zeros(2, np.int32),
        inverse_bind=np.tile(np.eye(4), (2, 1, 1)),
        vertex_joints=joints,
        vertex_weights=np.tile((1.0, 0, 0, 0), (8, 1)),
    )
    result = optimized(replace(double, deformations=[skin]), OWN)
    assert len(result.positions) == 5
    (kept,) = result.deformations
    assert (
        kept.vertex_joints[mesh_indices(result, 0)].max(axis=1).tolist()
        == joints[indices].max(axis=1).tolist()
    )


def test_tangents_that_nobody_reads_may_be_left_out_of_account():
    positions, indices = grid(3, 3)
    scene = scene_of((positions[indices], np.arange(54, dtype=np.uint32)))
    turned = scene.tangents.copy()
    turned[:, :3] += np.random.default_rng(0).normal(size=(54, 3)).astype(np.float32)
    scene = replace(scene, tangents=turned)
    assert len(optimized(scene, OWN).positions) == 54
    assert len(optimized(scene, OWN, unused_tangents=False).positions) == 16
    bumpy = replace(scene, materials=[Material(normal_texture=TextureRef(0))])
    assert len(optimized(bumpy, OWN, unused_tangents=False).positions) == 54
    turned[:, 3] = np.where(np.arange(54) < 27, -1, 1)  # the handedness counts in any case
    assert len(optimized(scene, OWN, unused_tangents=False).positions) > 16


def test_meshes_that_are_posed_with_flat_normals_stay_as_they_are():
    positions, indices = shuffled(grid(2, 2))
    flat = positions[indices], np.arange(len(indices), dtype=np.uint32)
    scene = replace(scene_of(flat), deformations=[Deformation(mesh=0, node=0, flat=True)])
    result = optimized(scene, OWN)
    assert np.array_equal(result.positions, scene.positions)
    assert np.array_equal(result.indices, scene.indices)


def test_an_edit_of_one_scene_is_none_of_the_other():
    scene = scene_of(grid(2, 2))
    result = optimized(scene, OWN)
    with result.edit() as change:
        change.set_transform(0, matrix=np.diag((2.0, 2, 2, 1)))
        change.set_visible(0, False)
        change.set_material(0, replace(scene.materials[0], name="other"))
    assert np.array_equal(scene.nodes.matrix[0], np.eye(4))
    assert scene.instances.visible.all() and scene.materials[0].name == ""
    assert scene.revision[Change.TRANSFORMS] == 0


@pytest.mark.feature("mesh/bounds")
def test_boxes_hold_what_is_drawn_and_touch_it():
    scene = three_meshes()
    for every in (scene, optimized(scene, OWN)):
        boxes = mesh_bounds(every)
        for mesh in range(3):
            drawn = mesh_positions(every, mesh)[mesh_indices(every, mesh)]
            assert ((drawn >= boxes[mesh, 0]) & (drawn <= boxes[mesh, 1])).all()
            assert (drawn == boxes[mesh, 0]).any(axis=0).all() and (drawn == boxes[mesh, 1]).any(axis=0).all()
        assert np.array_equal(boxes[:2, 0], scene.meshes["bounds_min"][:2])
        assert np.array_equal(boxes[:2, 1], scene.meshes["bounds_max"][:2])


def test_a_mesh_without_triangles_has_a_box_of_zeros():
    scene = three_meshes()
    meshes = scene.meshes.copy()
    meshes["index_count"][1] = 0
    boxes = mesh_bounds(replace(scene, meshes=meshes))
    assert np.array_equal(boxes[[0, 2]], mesh_bounds(scene)[[0, 2]]) and not boxes[1].any()
    empty = replace(scene, instances=Instances(np.zeros(0, np.int32), np.zeros(0, np.int32)))
    empty = replace(empty, meshes=meshes[:0], mesh_names=[])
    assert mesh_bounds(empty).shape == (0, 2, 3)
    assert len(optimized(empty, OWN).positions) == 0


@pytest.mark.feature("mesh/optimize")
def test_a_missing_package_and_a_wrong_pass_are_one_sentence(monkeypatch):
    monkeypatch.setitem(sys.modules, "meshoptimizer", None)
    with pytest.raises(UserError) as caught:
        optimized(three_meshes())
    assert str(caught.value) == (
        "ordering triangles (cache, overdraw) needs the package meshoptimizer, which a C++ compiler builds from "
        "source: run `pip install meshoptimizer==0.2.30a0`"
    )
    with pytest.raises(UserError, match=r"^there is no pass 'fetsch' over meshes; did you mean 'fetch'\?$"):
        optimized(three_meshes(), ["remap", "fetsch"])
