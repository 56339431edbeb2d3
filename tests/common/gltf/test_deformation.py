"""Skins and morph targets from file to pose, against sums written out vertex by vertex."""

from __future__ import annotations

import numpy as np
import pytest

from common.gltf import load_scene
from common.scene import Scene
from common.scene.pose import evaluate_pose
from tests.common.gltf.builder import QUAD, QUAD_INDICES, TRIANGLE, Gltf
from tests.common.gltf.test_animation import channel
from tests.common.gltf.test_nodes import trs

RNG = np.random.default_rng(33)
UP = np.tile((0, 0, 1), (4, 1)).astype("f4")


def world_positions(scene: Scene, time: float, instance: int = 0) -> np.ndarray:
    pose = evaluate_pose(scene, time)
    mesh = int(scene.instances.mesh[instance])
    matrix = pose.world_from_object[instance]
    return pose.vertices[mesh][0] @ matrix[:3, :3].T + matrix[:3, 3]


def random_trs() -> tuple[dict, np.ndarray]:
    t, s, q = RNG.normal(size=3), RNG.uniform(0.5, 2, 3), RNG.normal(size=4)
    q /= np.linalg.norm(q)
    return {"translation": t.tolist(), "rotation": q.tolist(), "scale": s.tolist()}, trs(t, q, s)


@pytest.mark.parametrize("sets", [1, 2])
@pytest.mark.parametrize("coded", ["u1", "u2"])
def test_a_skin_against_the_sum(tmp_path, sets, coded):
    """Sum over joints of weight * world(joint) * inverse bind, in which the mesh's own node has no part."""
    gltf, joints = Gltf(), 6
    entries = [random_trs() for _ in range(joints)]
    world = [entries[0][1]]
    for index in range(joints):
        children = {"children": [index + 1]} if index + 1 < joints else {}
        gltf.node(**entries[index][0], **children)
        if index:
            world.append(world[-1] @ entries[index][1])
    bind = np.stack([random_trs()[1] for _ in range(joints)])
    used = RNG.integers(0, joints, (4, 4 * sets))
    weights = RNG.random((4, 4 * sets)).astype("f4")
    weights[2] *= 3  # sums to something else than 1
    attributes = {}
    for number in range(sets):
        part = slice(4 * number, 4 * number + 4)
        attributes[f"JOINTS_{number}"] = used[:, part].astype(coded)
        attributes[f"WEIGHTS_{number}"] = weights[:, part].copy()
    stored = bind.transpose(0, 2, 1).reshape(joints, 16).astype("f4")
    gltf.add("skins", {"joints": list(range(joints)), "inverseBindMatrices": gltf.accessor(stored)})
    place = random_trs()[0]
    gltf.draw(gltf.primitive(QUAD_INDICES, POSITION=QUAD, NORMAL=UP, **attributes), skin=0, **place)
    scene = load_scene(gltf.write(tmp_path))
    got = world_positions(scene, 0.0)
    bind32 = stored.reshape(joints, 4, 4).transpose(0, 2, 1).astype(np.float64)
    for vertex in range(4):
        share = weights[vertex].astype(np.float64)
        share /= share.sum()
        matrix = sum(w * world[j] @ bind32[j] for w, j in zip(share, used[vertex], strict=True))
        np.testing.assert_allclose(got[vertex], (matrix @ [*QUAD[vertex], 1])[:3], atol=2e-5)
        normal = np.linalg.inv(matrix[:3, :3]).T @ (0, 0, 1)
        pose = evaluate_pose(scene, 0.0)
        np.testing.assert_allclose(pose.vertices[0][1][vertex], normal / np.linalg.norm(normal), atol=1e-5)


def test_weights_as_normalised_bytes(tmp_path):
    gltf = Gltf()
    gltf.node(translation=[1, 0, 0])
    gltf.node(translation=[0, 10, 0])
    gltf.add("skins", {"joints": [0, 1]})
    attributes = {
        "POSITION": TRIANGLE,
        "JOINTS_0": np.tile((0, 1, 0, 0), (3, 1)).astype("u1"),
        "WEIGHTS_0": gltf.accessor(np.tile((51, 204, 0, 0), (3, 1)), "u1", normalized=True),
    }
    gltf.draw(gltf.primitive(**attributes), skin=0)
    scene = load_scene(gltf.write(tmp_path))
    np.testing.assert_allclose(world_positions(scene, 0.0), TRIANGLE + np.array((0.2, 8, 0)), atol=1e-6)


def test_a_vertex_that_nothing_holds_follows_its_first_joint(tmp_path):
    gltf = Gltf()
    gltf.node(translation=[1, 0, 0])
    gltf.add("skins", {"joints": [0]})
    joints = np.array([(0, 9, 9, 9)] * 3, "u1")  # joints of weight 0 may be anything
    weights = np.array([(1, 0, 0, 0), (0, 0, 0, 0), (0.5, 0, 0, 0)], "f4")
    gltf.draw(gltf.primitive(POSITION=TRIANGLE, JOINTS_0=joints, WEIGHTS_0=weights), skin=0)
    scene = load_scene(gltf.write(tmp_path))
    np.testing.assert_allclose(world_positions(scene, 0.0), TRIANGLE + np.array((1, 0, 0)), atol=1e-6)


def test_a_skinned_mesh_far_from_zero_keeps_its_shape(tmp_path):
    gltf = Gltf()
    gltf.node(translation=[1e7, 0, 0])
    gltf.add("skins", {"joints": [0]})
    ones = np.tile((1, 0, 0, 0), (3, 1))
    gltf.draw(
        gltf.primitive(POSITION=TRIANGLE, JOINTS_0=0 * ones.astype("u1"), WEIGHTS_0=ones.astype("f4")), skin=0
    )
    scene = load_scene(gltf.write(tmp_path))
    assert np.array_equal(world_positions(scene, 0.0) - (1e7, 0, 0), TRIANGLE)


def morphing(
    tmp_path, weights: dict, animate: bool = False, normals: bool = True, use_library: bool = False
) -> tuple[Scene, np.ndarray]:
    """A quad with two targets; returns the scene and the offsets (2, 4, 3)."""
    gltf = Gltf()
    offsets = RNG.normal(size=(2, 4, 3)).astype("f4")
    tilt = np.array((0.5, 0, 0), "f4") * np.ones((4, 1), "f4")
    targets = [{"POSITION": offsets[0], "NORMAL": tilt}, {"POSITION": offsets[1]}]
    if not normals:
        targets = [{"POSITION": offset} for offset in offsets]
    attributes = {"POSITION": QUAD, **({"NORMAL": UP} if normals else {})}
    mesh = gltf.mesh(
        gltf.primitive(QUAD_INDICES, targets=targets, **attributes),
        **({"weights": weights["mesh"]} if "mesh" in weights else {}),
    )
    gltf.node(mesh=mesh, **({"weights": weights["node"]} if "node" in weights else {}))
    if animate:
        channel(gltf, [0.0, 1.0], [0.0, 1.0, 1.0, -1.0], "weights")
    return load_scene(gltf.write(tmp_path), use_library=use_library), offsets


@pytest.mark.parametrize("use_library", [True, False])
def test_constant_weights_are_applied_at_once(tmp_path, use_library):
    scene, offsets = morphing(tmp_path, {"mesh": [0.5, -2.0]}, use_library=use_library)
    assert scene.deformations == []
    np.testing.assert_allclose(scene.positions, QUAD + 0.5 * offsets[0] - 2 * offsets[1], atol=1e-6)
    normal = np.array((0.25, 0, 1)) / np.hypot(0.25, 1)
    np.testing.assert_allclose(scene.normals, np.tile(normal, (4, 1)), atol=1e-6)
    # The node's own come first.
    scene, offsets = morphing(tmp_path, {"mesh": [0.5, -2.0], "node": [0.0, 1.0]}, use_library=use_library)
    np.testing.assert_allclose(scene.positions, QUAD + offsets[1], atol=1e-6)


def test_animated_weights(tmp_path):
    scene, offsets = morphing(tmp_path, {"mesh": [9.0, 9.0]}, animate=True)
    for time in (0.0, 0.25, 0.75):
        expected = QUAD + time * offsets[0] + (1 - 2 * time) * offsets[1]
        np.testing.assert_allclose(world_positions(scene, time), expected, atol=1e-6)
        normal = np.array((0.5 * time, 0, 1)) / np.hypot(0.5 * time, 1)
        np.testing.assert_allclose(evaluate_pose(scene, time).vertices[0][1][0], normal, atol=1e-6)
    assert np.array_equal(scene.positions, QUAD)


def test_flat_normals_follow_the_posed_triangles(tmp_path):
    scene, _ = morphing(tmp_path, {}, animate=True, normals=False)
    positions, normals, tangents = evaluate_pose(scene, 0.6).vertices[0]
    corners = positions.reshape(-1, 3, 3).astype(np.float64)
    faces = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    faces /= np.linalg.norm(faces, axis=1, keepdims=True)
    np.testing.assert_allclose(normals, np.repeat(faces, 3, axis=0), atol=1e-5)
    np.testing.assert_allclose((normals * tangents[:, :3]).sum(axis=1), 0, atol=1e-6)


def test_a_mesh_that_two_nodes_morph_is_two_meshes(tmp_path):
    gltf = Gltf()
    mesh = gltf.mesh(gltf.primitive(QUAD_INDICES, targets=[{"POSITION": QUAD}], POSITION=QUAD, NORMAL=UP))
    for node in range(2):
        gltf.node(mesh=mesh)
        channel(gltf, [0.0], [float(node + 1)], "weights", node=node)
    scene = load_scene(gltf.write(tmp_path))
    assert scene.instances.mesh.tolist() == [0, 1]
    assert scene.meshes["first_vertex"].tolist() == [0, 4]  # each has vertices of its own to be written
    np.testing.assert_allclose(world_positions(scene, 0.0, 0), 2 * QUAD)
    np.testing.assert_allclose(world_positions(scene, 0.0, 1), 3 * QUAD)


def test_morph_before_skin(tmp_path):
    gltf = Gltf()
    gltf.node(scale=[3, 3, 3])
    gltf.add("skins", {"joints": [0]})
    ones = np.tile((1, 0, 0, 0), (4, 1))
    part = gltf.primitive(
        QUAD_INDICES,
        targets=[{"POSITION": UP}],
        POSITION=QUAD,
        NORMAL=UP,
        JOINTS_0=(0 * ones).astype("u1"),
        WEIGHTS_0=ones.astype("f4"),
    )
    node = gltf.draw(part, skin=0)
    channel(gltf, [0.0, 2.0], [0.0, 1.0], "weights", node=node)
    scene = load_scene(gltf.write(tmp_path))
    np.testing.assert_allclose(world_positions(scene, 1.0), 3 * (QUAD + 0.5 * UP), atol=1e-6)


def test_the_sample_models(models):
    """Figures of the Khronos tutorial: the skin bends about (0, 1), the triangle's tip moves by its targets."""
    skin = load_scene(models / "SimpleSkin" / "SimpleSkin.gltf")
    rest = world_positions(skin, 0.0)
    assert np.allclose(rest[:, 0].min(), -0.5, atol=1e-6) and np.allclose(rest[:, 1].max(), 2.0, atol=1e-6)
    bent = world_positions(skin, 1.0)
    assert np.allclose(bent[rest[:, 1] == 0], rest[rest[:, 1] == 0], atol=1e-6)  # held by the root alone
    top = rest[:, 1] > 1.9
    assert not np.allclose(bent[top], rest[top], atol=0.3)
    distance = np.linalg.norm(bent[top] - (0, 1, 0), axis=1)
    assert np.allclose(distance, np.linalg.norm(rest[top] - (0, 1, 0), axis=1), atol=1e-5)
    morph = load_scene(models / "SimpleMorph" / "SimpleMorph.gltf")
    tips = {time: world_positions(morph, time)[2] for time in (0.0, 1.0, 2.0)}
    assert np.allclose(tips[0.0], (0.5, 0.5, 0), atol=1e-6)
    assert not np.allclose(tips[1.0], tips[0.0]) and not np.allclose(tips[2.0], tips[1.0])
