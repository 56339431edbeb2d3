"""Merging by material: the same triangles in the same places, facing the same way, in fewer draws."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from common.errors import UserError
from common.mesh.merge import mergeable, merged_by_material
from common.mesh.pools import mesh_bounds, mesh_indices
from common.numerics.transforms import compose, quaternion_from_axis_angle
from common.scene import Animation, AnimationChannel, Deformation, Instances, Material, Scene
from common.scene.pose import evaluate_pose
from tests.support.meshes import grid, scene_of
from tests.support.scenes import nodes_at, translated

KINDS = (Material("stone"), Material("leaf", alpha_mode="mask"), Material("glass", alpha_mode="blend"))


def placed(seed: int, mirror: bool = False) -> np.ndarray:
    rng = np.random.default_rng(seed)
    scale = rng.uniform(0.5, 2, 3) * np.array([-1 if mirror else 1, 1, 1])
    return compose(rng.uniform(-5, 5, 3), quaternion_from_axis_angle(rng.normal(size=3), 2.0), scale)


def world_corners(scene: Scene, origin: np.ndarray) -> np.ndarray:
    """Return (T, 3, 12) every triangle that is drawn, sorted: position, normal, tangent and bitangent in the world.

    Triangles begin with their smallest corner; a mirrored instance is drawn clockwise. Written without the module
    that is tested: normals by the inverse transpose, bitangents as glTF has them and then by the matrix.
    """
    pose = evaluate_pose(scene, 0.0)
    found = []
    for node_matrix, mesh, visible in zip(
        pose.world_from_object, scene.instances.mesh, scene.instances.visible, strict=True
    ):
        if not visible:
            continue
        places = int(scene.meshes["first_vertex"][mesh]) + mesh_indices(scene, mesh).astype(int)
        linear = node_matrix[:3, :3]
        normal, tangent = scene.normals[places].astype(float), scene.tangents[places].astype(float)
        bitangent = np.cross(normal, tangent[:, :3]) * tangent[:, 3:]
        away = scene.positions[places] @ linear.T + (node_matrix[:3, 3] - origin)
        rows = [away, normal @ np.linalg.inv(linear)]
        for vectors in (tangent[:, :3], bitangent):
            vectors = vectors @ linear.T
            # Only what is perpendicular to the normal counts: a scale makes tangents oblique.
            rows.append(vectors)
        unit = rows[1] / np.linalg.norm(rows[1], axis=1, keepdims=True)
        rows[1] = unit
        rows[2] -= unit * (rows[2] * unit).sum(axis=1, keepdims=True)
        rows[2] /= np.linalg.norm(rows[2], axis=1, keepdims=True)
        side = (np.cross(unit, rows[2]) * rows[3]).sum(axis=1, keepdims=True)
        rows[3] = np.sign(side) * np.cross(unit, rows[2])  # which of the two sides the bitangent is on
        corners = np.concatenate(rows, axis=1).reshape(-1, 3, 12)
        found.append(corners[:, ::-1] if np.linalg.det(linear) < 0 else corners)
    triangles = np.concatenate(found)
    keys = np.round(triangles[:, :, :3], 3) @ (1.0, 17.3, 291.7)
    first = keys.argmin(axis=1)
    triangles = triangles[np.arange(len(triangles))[:, None], (first[:, None] + np.arange(3)) % 3]
    centers = triangles[:, :, :3].mean(axis=1)
    return triangles[np.argsort(centers @ (1.0, 17.3, 291.7))]


def same_drawing(a: Scene, b: Scene) -> bool:
    return np.allclose(world_corners(a, a.origin), world_corners(b, a.origin), rtol=0, atol=4e-6)


@pytest.mark.feature("mesh/merge-by-material")
@pytest.mark.parametrize("offset", [0.0, 1e5])
def test_triangles_stay_in_the_world_and_draws_become_one_per_material(offset):
    far = translated(offset, 0, -offset)
    matrices = tuple(far @ placed(seed, mirror=seed % 2 == 1) for seed in range(7))
    scene = scene_of(
        *(grid(2, 3), grid(3, 3, seed=4), grid(1, 4)),
        matrices=matrices,
        drawn=(0, 1, 0, 2, 1, 2, 2),
        materials=(0, 1, 0),
        kinds=KINDS,
    )
    before = [
        values.tobytes() for values in (scene.positions, scene.indices, scene.meshes, scene.nodes.matrix)
    ]
    result = merged_by_material(scene)
    merged = result.scene
    assert [v.tobytes() for v in (scene.positions, scene.indices, scene.meshes, scene.nodes.matrix)] == before
    # Five draws of material 0 and two of material 1.
    assert len(merged.instances) == 7 - 5 + 1 - 2 + 1 == 2
    assert result.instance.tolist() == [0, 1, 0, 0, 1, 0, 0]
    assert merged.triangle_count == scene.triangle_count
    assert merged.meshes["material"].tolist() == [0, 1]
    assert merged.mesh_names == ["merged stone", "merged leaf"] == merged.nodes.names[7:]
    assert same_drawing(scene, merged)
    boxes = mesh_bounds(merged)
    assert np.array_equal(boxes[:, 0], merged.meshes["bounds_min"])
    assert np.array_equal(boxes[:, 1], merged.meshes["bounds_max"])
    assert np.abs(merged.positions).max() < 20  # the node carries the distance from zero, not the vertices


@pytest.mark.feature("mesh/merge-by-material")
def test_only_the_materials_that_were_named_are_merged():
    scene = scene_of(
        *(grid(1, 2), grid(2, 2), grid(1, 1)),
        matrices=tuple(placed(seed) for seed in range(6)),
        drawn=(0, 1, 2, 0, 1, 2),
        materials=(0, 1, 1),
        kinds=KINDS,
    )
    result = merged_by_material(scene, materials=[1])
    assert len(result.scene.instances) == 6 - 4 + 1
    assert result.instance.tolist() == [0, 2, 2, 1, 2, 2]
    assert result.scene.meshes["material"].tolist() == [0, 1]
    assert len(result.scene.positions) == 6 + 2 * 9 + 2 * 4  # the block of mesh 0 once
    assert same_drawing(scene, result.scene)


def test_parts_with_one_transform_keep_their_bits():
    matrix = placed(3, mirror=True)
    scene = scene_of(
        grid(2, 2), grid(1, 3), matrices=(matrix, matrix), drawn=(0, 1), materials=(0, 0), kinds=KINDS
    )
    scene = replace(scene, colors=np.random.default_rng(1).random((len(scene.positions), 4), np.float32))
    merged = merged_by_material(scene).scene
    for name in ("positions", "normals", "tangents", "uv0", "colors"):
        assert np.array_equal(getattr(merged, name), getattr(scene, name))
    assert np.array_equal(merged.nodes.matrix[merged.instances.node[0]], matrix)
    assert same_drawing(scene, merged)


def test_what_moves_deforms_hides_or_blends_is_left_alone():
    matrices = tuple(placed(seed) for seed in range(8))
    drawn = (0, 0, 0, 0, 1, 2, 2, 0)
    scene = scene_of(
        *(grid(1, 1), grid(1, 2), grid(2, 1)),
        matrices=matrices,
        drawn=drawn,
        materials=(0, 0, 2),
        kinds=KINDS,
    )
    nodes = nodes_at(*matrices)
    nodes.has_matrix[1] = False
    nodes.parent[2] = 1  # below the node that moves
    nodes = replace(nodes)
    times, values = np.array([0.0, 1.0]), np.array([(0.0, 0, 0), (1, 0, 0)])
    channel = AnimationChannel(1, "translation", times, values, "linear")
    scene = replace(
        scene,
        nodes=nodes,
        animations=[Animation("swing", (channel,), 1.0)],
        deformations=[Deformation(mesh=1, node=4)],
        instances=Instances(scene.instances.node, scene.instances.mesh, None, np.arange(8) != 3),
    )
    assert mergeable(scene).tolist() == [True, False, False, False, False, False, False, True]
    result = merged_by_material(scene)
    assert result.instance.tolist() == [6, 0, 1, 2, 3, 4, 5, 6]
    assert result.scene.instances.visible.tolist() == [True, True, False, True, True, True, True]
    (deformation,) = result.scene.deformations
    assert result.scene.mesh_names[deformation.mesh] == "mesh 1"
    assert same_drawing(scene, result.scene)


def test_instances_with_matrices_of_their_own_are_merged_where_they_stand():
    scene = scene_of(grid(2, 2), matrices=(placed(1), placed(2)), drawn=(0, 0), kinds=KINDS)
    local = np.stack([placed(5, mirror=True), placed(6), placed(7)])
    node, mesh = np.array([0, 0, 1], np.int32), np.zeros(3, np.int32)
    scene = replace(scene, instances=Instances(node, mesh, local))
    merged = merged_by_material(scene).scene
    assert len(merged.instances) == 1
    assert same_drawing(scene, merged)


def test_nothing_to_merge_gives_a_copy():
    scene = scene_of(grid(2, 2), grid(1, 1), drawn=(1,), kinds=KINDS)
    result = merged_by_material(scene)
    assert result.instance.tolist() == [0] and len(result.scene.nodes) == len(scene.nodes)
    for name in ("positions", "indices", "meshes"):
        assert np.array_equal(getattr(result.scene, name), getattr(scene, name))


@pytest.mark.feature("mesh/merge-by-material")
def test_a_merge_that_is_too_large_is_one_sentence(monkeypatch):
    scene = scene_of(grid(9, 9), matrices=(np.eye(4),) * 3, drawn=(0, 0, 0))
    monkeypatch.setattr("common.mesh.merge.MAX_VERTICES", 299)
    with pytest.raises(UserError) as caught:
        merged_by_material(scene)
    assert str(caught.value) == (
        "merging would give the scene 'quad' 300 vertices, more than 299: merge fewer materials"
    )
