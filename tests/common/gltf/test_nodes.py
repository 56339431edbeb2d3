"""Nodes, cameras and lights: matrices against products written out, everything else as the file says it."""

from __future__ import annotations

import math

import numpy as np
import pytest

from common.gltf import load_scene
from common.scene.pose import evaluate_pose
from tests.common.gltf.builder import QUAD, TRIANGLE, Gltf, triangle

RNG = np.random.default_rng(12)


def rotation_of(q: np.ndarray) -> np.ndarray:
    """(3, 3) rotation of a unit quaternion xyzw, through axis and angle (Rodrigues)."""
    angle = 2 * math.atan2(float(np.linalg.norm(q[:3])), q[3])
    axis = q[:3] / (np.linalg.norm(q[:3]) or 1.0)
    cross = np.array([(0, -axis[2], axis[1]), (axis[2], 0, -axis[0]), (-axis[1], axis[0], 0)])
    return np.eye(3) + math.sin(angle) * cross + (1 - math.cos(angle)) * cross @ cross


def trs(t: np.ndarray, q: np.ndarray, s: np.ndarray) -> np.ndarray:
    """(4, 4) translation * rotation * scale."""
    matrix = np.eye(4)
    matrix[:3, :3] = rotation_of(q) @ np.diag(s)
    matrix[:3, 3] = t
    return matrix


@pytest.mark.feature("scene/gltf-loader")
def test_a_random_forest_of_trs_and_matrices(tmp_path):
    gltf, count = triangle(), 60
    parents = [-1, *(int(RNG.integers(-1, index)) for index in range(1, count))]
    shuffled = RNG.permutation(count).tolist()  # children before parents, and after
    local, nodes = [], [{} for _ in range(count)]
    for index in range(count):
        t, s = RNG.normal(size=3), RNG.uniform(0.5, 2, 3) * RNG.choice([-1, 1], 3)
        q = RNG.normal(size=4)
        q /= np.linalg.norm(q)
        entry = nodes[shuffled[index]]
        entry["name"] = f"n{index}"
        if index % 3 == 0:
            matrix = trs(t, q, s)
            matrix[:3, :3] += 0.1 * RNG.normal(size=(3, 3))  # sheared: no TRS gives it
            entry["matrix"] = matrix.T.reshape(-1).tolist()
            local.append(matrix)
        elif index % 3 == 1:
            entry |= {"translation": t.tolist(), "rotation": q.tolist(), "scale": s.tolist()}
            local.append(trs(t, q, s))
        else:
            entry["rotation"] = (2 * q).tolist()  # not a unit quaternion, as exporters write them
            local.append(trs(np.zeros(3), q, np.ones(3)))
        if parents[index] >= 0:
            nodes[shuffled[parents[index]]].setdefault("children", []).append(shuffled[index])
    nodes[shuffled[0]]["mesh"] = 0
    gltf.json["nodes"] = nodes
    scene = load_scene(gltf.write(tmp_path))
    assert (scene.nodes.parent < np.arange(count)).all()
    np.testing.assert_allclose(np.linalg.norm(scene.nodes.rotation, axis=1), 1, rtol=1e-12)
    world: list[np.ndarray] = []
    for index in range(count):
        world.append(local[index] if parents[index] < 0 else world[parents[index]] @ local[index])
    pose = evaluate_pose(scene, 0.0)
    for index in range(count):
        place = scene.nodes.names.index(f"n{index}")
        np.testing.assert_allclose(pose.world_from_node[place], world[index], rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(pose.world_from_object[0], world[0], rtol=1e-12, atol=1e-12)


def test_far_from_zero_a_node_keeps_its_place(tmp_path):
    """1e6 m away a float32 moves in steps of 6 cm; the loader must not go through one."""
    gltf = Gltf()
    child = gltf.draw(gltf.primitive(POSITION=TRIANGLE), translation=[0.015625, 0, 0])
    gltf.node(children=[child], translation=[1e6 + 0.001, 0, 0])
    scene = load_scene(gltf.write(tmp_path))
    x = evaluate_pose(scene, 0.0).world_from_object[0, 0, 3]
    assert x == pytest.approx(1e6 + 0.016625, abs=1e-9)
    assert scene.origin[0] == pytest.approx(1e6 + 0.516625, abs=1e-9)


def test_cameras(tmp_path):
    gltf = Gltf()
    lens = {"yfov": 0.8, "znear": 0.01, "zfar": 50.0, "aspectRatio": 1.5}
    wide = gltf.add("cameras", {"type": "perspective", "name": "wide", "perspective": lens})
    plain = gltf.add("cameras", {"type": "perspective", "perspective": {"yfov": 1.0, "znear": 0.2}})
    plan = {"xmag": 3.0, "ymag": -2.0, "znear": 0.0, "zfar": 9.0}
    plan_view = gltf.add(
        "cameras", {"type": "orthographic", "orthographic": plan, "extras": {"strata": {"ev100": 7}}}
    )
    for number, name in ((plan_view, None), (plain, "by node"), (wide, None)):
        gltf.node(camera=number, **({"name": name} if name else {}))
    cameras = load_scene(gltf.write(tmp_path)).cameras
    assert [(c.name, c.kind, c.node) for c in cameras] == [
        ("camera 2", "orthographic", 0),
        ("by node", "perspective", 1),
        ("wide", "perspective", 2),
    ]
    assert (cameras[0].ymag, cameras[0].near, cameras[0].far, cameras[0].aspect) == (2.0, 0.0, 9.0, 1.5)
    assert (cameras[0].ev100, cameras[2].ev100) == (7, None)
    assert (cameras[1].yfov, cameras[1].near, cameras[1].far, cameras[1].aspect) == (1.0, 0.2, math.inf, None)
    assert (cameras[2].yfov, cameras[2].near, cameras[2].far, cameras[2].aspect) == (0.8, 0.01, 50.0, 1.5)


def test_lights(tmp_path):
    gltf = Gltf()
    lights = [
        {"type": "directional", "intensity": 3, "color": [1, 0.5, 0]},
        {"type": "point", "range": 4.5, "name": "bulb"},
        {"type": "spot", "intensity": 100, "spot": {"innerConeAngle": 0.2, "outerConeAngle": 0.7}},
        {"type": "spot", "spot": {}},
    ]
    gltf.json["extensions"] = {"KHR_lights_punctual": {"lights": lights}}
    for number in (1, 0, 2, 3, 1):
        gltf.node(extensions={"KHR_lights_punctual": {"light": number}})
    got = load_scene(gltf.write(tmp_path)).lights
    assert [light.kind for light in got] == ["point", "directional", "spot", "spot", "point"]
    assert [light.node for light in got] == [0, 1, 2, 3, 4]
    assert got[0].range == 4.5 and got[0].intensity == 1.0 and got[0].name == "bulb"
    assert got[1].color == (1.0, 0.5, 0.0) and got[1].intensity == 3.0 and got[1].range == math.inf
    assert (got[2].inner_cone, got[2].outer_cone) == (0.2, 0.7)
    assert (got[3].inner_cone, got[3].outer_cone) == (0.0, math.pi / 4)


def test_a_negative_intensity_gives_no_light_and_is_told(tmp_path):
    gltf = Gltf()
    lights = [{"type": "point", "intensity": -5, "name": "hole"}, {"type": "point", "intensity": 0}]
    gltf.json["extensions"] = {"KHR_lights_punctual": {"lights": lights}}
    for number in (0, 1):
        gltf.node(extensions={"KHR_lights_punctual": {"light": number}})
    scene = load_scene(gltf.write(tmp_path))
    assert [light.intensity for light in scene.lights] == [0.0, 0.0]
    assert scene.warnings == ["The light 'hole' has a negative intensity and gives no light."]


@pytest.mark.parametrize(
    "spot",
    [{"innerConeAngle": 0.7, "outerConeAngle": 0.7}, {"outerConeAngle": 1.6}, {"innerConeAngle": -0.1}],
)
def test_cones_that_the_extension_forbids(tmp_path, spot):
    from common.errors import SceneError

    gltf = Gltf()
    gltf.json["extensions"] = {"KHR_lights_punctual": {"lights": [{"type": "spot", "spot": spot}]}}
    gltf.node(extensions={"KHR_lights_punctual": {"light": 0}})
    with pytest.raises(SceneError, match="inner must be the smaller"):
        load_scene(gltf.write(tmp_path))


# --- EXT_mesh_gpu_instancing ---


@pytest.mark.parametrize("coded", ["f4", "i1", "i2"])
def test_instancing_composes_under_the_node(tmp_path, coded):
    count = 5
    t, s = RNG.normal(size=(count, 3)).astype("f4"), RNG.uniform(0.5, 2, (count, 3)).astype("f4")
    q = RNG.normal(size=(count, 4))
    q /= np.linalg.norm(q, axis=1, keepdims=True)
    gltf = Gltf()
    if coded == "f4":
        rotation = gltf.accessor(q, "f4")
    else:
        top = np.iinfo(coded).max
        stored = np.round(q * top)
        rotation = gltf.accessor(stored, coded, normalized=True)
        q = stored / np.linalg.norm(stored, axis=1, keepdims=True)
    attributes = {"TRANSLATION": gltf.accessor(t), "ROTATION": rotation, "SCALE": gltf.accessor(s)}
    mesh = gltf.mesh(gltf.primitive(POSITION=TRIANGLE), gltf.primitive(POSITION=QUAD, mode=6))
    gltf.node(
        mesh=mesh,
        translation=[1, 2, 3],
        scale=[2, 2, 2],
        extensions={"EXT_mesh_gpu_instancing": {"attributes": attributes}},
    )
    gltf.node(mesh=mesh)
    scene = load_scene(gltf.write(tmp_path))
    assert len(scene.meshes) == 2 and scene.instances.mesh.tolist() == [0] * 5 + [1] * 5 + [0, 1]
    node = trs(np.array((1, 2, 3)), np.array((0, 0, 0, 1.0)), np.full(3, 2.0))
    got = evaluate_pose(scene, 0.0).world_from_object
    for copy in range(count):
        expected = node @ trs(t[copy], q[copy], s[copy])
        np.testing.assert_allclose(got[copy], expected, atol=1e-6)
        np.testing.assert_array_equal(got[copy], got[copy + 5])
    np.testing.assert_array_equal(got[10:], np.tile(np.eye(4), (2, 1, 1)))
    assert scene.triangle_count == 5 * 3 + 3


def test_one_instance_at_its_node_is_no_copy(tmp_path):
    gltf = triangle()
    attributes = {"TRANSLATION": gltf.accessor(np.zeros((1, 3)), "f4")}
    gltf.json["nodes"][0]["extensions"] = {"EXT_mesh_gpu_instancing": {"attributes": attributes}}
    assert load_scene(gltf.write(tmp_path)).instances.local is None


@pytest.mark.parametrize(
    ("attributes", "fault"),
    [
        ({}, "has none of TRANSLATION"),
        ({"TRANSLATION": np.zeros((2, 3)), "SCALE": np.zeros((3, 3))}, "different counts: 2, 3"),
        ({"ROTATION": np.zeros((2, 4))}, "zero quaternion"),
        ({"TRANSLATION": np.zeros((2, 4))}, "is VEC4 instead of VEC3"),
    ],
)
def test_instancing_that_is_wrong(tmp_path, attributes, fault):
    from common.errors import SceneError

    gltf = triangle()
    numbers = {name: gltf.accessor(values, "f4") for name, values in attributes.items()}
    gltf.json["nodes"][0]["extensions"] = {"EXT_mesh_gpu_instancing": {"attributes": numbers}}
    with pytest.raises(SceneError, match=fault):
        load_scene(gltf.write(tmp_path))
