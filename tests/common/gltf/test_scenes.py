"""Whole files: real models, the same scene from every container, what a generated file says comes back."""

from __future__ import annotations

import dataclasses
import json
import math

import numpy as np
import pytest

from common.gltf import images as decoder
from common.gltf import load_scene
from common.gltf.document import read_document
from common.paths import asset_dir
from common.scene import Scene
from tests.common.gltf.builder import QUAD, QUAD_INDICES, TRIANGLE, Gltf, triangle

ASSETS = asset_dir()
needs_assets = pytest.mark.skipif(ASSETS is None, reason="no models; set STRATA_ASSETS")
MODELS = sorted(ASSETS.glob("models/*/*.gl*")) if ASSETS else []
TRIANGLES = {
    "AlphaBlendModeTest": 61,
    "AnimatedCube": 12,
    "Box": 12,
    "BoxInterleaved": 12,
    "BoxVertexColors": 12,
    "Cameras": 2,
    "Cube": 12,
    "FlightHelmet": 94_722,
    "SimpleInstancing": 12 * 125,
    "SimpleMeshes": 2,
    "SimpleMorph": 1,
    "SimpleSkin": 8,
    "SimpleSparseAccessor": 12,
    "Suzanne": 3936,
    "ToyCar": 108_936,
    "Triangle": 1,
    "TriangleWithoutIndices": 1,
    "TwoSidedPlane": 2,
}


def assert_same(a, b, place="scene"):
    """Compare two values of a scene, field by field."""
    assert type(a) is type(b), place
    if dataclasses.is_dataclass(a):
        for field in dataclasses.fields(a):
            assert_same(getattr(a, field.name), getattr(b, field.name), f"{place}.{field.name}")
    elif isinstance(a, np.ndarray):
        assert a.dtype == b.dtype, place
        assert np.array_equal(a, b), place
    elif isinstance(a, list | tuple):
        assert len(a) == len(b), place
        for index, (one, other) in enumerate(zip(a, b, strict=True)):
            assert_same(one, other, f"{place}[{index}]")
    elif isinstance(a, dict):
        assert a.keys() == b.keys(), place
        for key in a:
            assert_same(a[key], b[key], f"{place}[{key}]")
    else:
        assert a == b, place


@needs_assets
@pytest.mark.feature("scene/gltf-loader")
def test_flight_helmet():
    """Six draws whose sum is the length of the index view (568,332 bytes of uint16)."""
    scene = load_scene(ASSETS / "models" / "FlightHelmet" / "FlightHelmet.gltf")
    assert scene.meshes["index_count"].tolist() == [59040, 72534, 24408, 60288, 65688, 2208]
    assert scene.meshes["index_count"].sum() == 284_166 == 568_332 // 2
    assert scene.triangle_count == 284_166 / 3
    assert (len(scene.images), len(scene.materials), len(scene.instances)) == (15, 6, 6)
    assert scene.meshes["vertex_count"][0] == 125_664 // 12  # the offset of the second run of normals


@needs_assets
@pytest.mark.feature("scene/gltf-loader")
def test_accessors_of_flight_helmet_equal_slices_of_its_file():
    folder = ASSETS / "models" / "FlightHelmet"
    document = json.loads((folder / "FlightHelmet.gltf").read_text())
    data = (folder / "FlightHelmet.bin").read_bytes()
    scene = load_scene(folder / "FlightHelmet.gltf")

    def cut(number, dtype, width):
        entry = document["accessors"][number]
        view = document["bufferViews"][entry["bufferView"]]
        start = view.get("byteOffset", 0) + entry.get("byteOffset", 0)
        assert view.get("byteStride", width * np.dtype(dtype).itemsize) == width * np.dtype(dtype).itemsize
        return np.frombuffer(data, dtype, entry["count"] * width, start).reshape(-1, width)

    for mesh, row in zip(document["meshes"], scene.meshes, strict=True):
        primitive = mesh["primitives"][0]
        vertices = slice(row["first_vertex"], row["first_vertex"] + row["vertex_count"])
        attributes = primitive["attributes"]
        assert np.array_equal(scene.positions[vertices], cut(attributes["POSITION"], "<f4", 3))
        assert np.array_equal(scene.uv0[vertices], cut(attributes["TEXCOORD_0"], "<f4", 2))
        assert np.allclose(scene.normals[vertices], cut(attributes["NORMAL"], "<f4", 3), atol=2e-6)
        indices = scene.indices[row["first_index"] : row["first_index"] + row["index_count"]]
        assert np.array_equal(indices, cut(primitive["indices"], "<u2", 1)[:, 0])


@needs_assets
@pytest.mark.parametrize("path", MODELS, ids=[path.stem for path in MODELS])
def test_models_are_the_same_by_both_parsers(path, monkeypatch):
    decode, known = decoder._decode, {}

    def decode_once(data, size, place):
        """Pixels are the same for the same bytes; which bytes, and for what, is for the parsers to say."""
        key = (data.tobytes(), size)
        if key not in known:
            known[key] = decode(data, size, place)
        return known[key]

    monkeypatch.setattr(decoder, "_decode", decode_once)
    through_library, through_json = load_scene(path, use_library=True), load_scene(path, use_library=False)
    assert_same(through_library, through_json)
    assert_sound(through_json)
    expected = TRIANGLES.get(path.stem)
    assert expected is None or through_json.triangle_count == expected


def assert_sound(scene: Scene):
    """Whatever a scene came from, a renderer may rely on this."""
    for name in ("positions", "normals", "tangents", "uv0", "uv1", "colors"):
        values = getattr(scene, name)
        if values is not None:
            assert values.dtype == np.float32
            assert values.flags.c_contiguous
            assert len(values) == len(scene.positions)
            assert np.isfinite(values).all(), name
    assert np.allclose(np.linalg.norm(scene.normals, axis=1), 1, atol=1e-5)
    assert np.allclose(np.linalg.norm(scene.tangents[:, :3], axis=1), 1, atol=1e-5)
    assert set(np.unique(scene.tangents[:, 3])) <= {-1, 1}
    for row in scene.meshes:
        indices = scene.indices[row["first_index"] : row["first_index"] + row["index_count"]]
        assert len(indices) == row["index_count"]
        assert row["index_count"] % 3 == 0
        assert indices.max() < row["vertex_count"]
        assert row["first_vertex"] + row["vertex_count"] <= len(scene.positions)
        drawn = scene.positions[row["first_vertex"] + indices]
        assert np.array_equal(drawn.min(axis=0), row["bounds_min"])
        assert np.array_equal(drawn.max(axis=0), row["bounds_max"])
        assert row["material"] < len(scene.materials)
    used = {texture.image for material in scene.materials for texture in material.textures().values()}
    assert used == set(range(len(scene.images)))
    assert (scene.nodes.parent < np.arange(len(scene.nodes))).all()


@pytest.mark.parametrize("form", ["gltf", "data", "glb"])
@pytest.mark.feature("scene/gltf-loader")
def test_a_generated_file_comes_back(tmp_path, form):
    rng = np.random.default_rng(3)
    count = 50
    normals = rng.normal(size=(count, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    attributes = {
        "POSITION": rng.normal(size=(count, 3)).astype("f4"),
        "NORMAL": normals.astype("f4"),
        "TANGENT": np.concatenate([np.roll(normals, 1, axis=0), np.ones((count, 1))], axis=1).astype("f4"),
        "TEXCOORD_0": rng.uniform(size=(count, 2)).astype("f4"),
        "TEXCOORD_1": rng.uniform(size=(count, 2)).astype("f4"),
        "COLOR_0": rng.uniform(size=(count, 4)).astype("f4"),
    }
    indices = rng.integers(0, count, 60).astype("u4")
    gltf = Gltf()
    gltf.draw(gltf.primitive(indices, **attributes), name="thing", translation=[1, 2, 3])
    scene = load_scene(gltf.write(tmp_path, form))
    assert_sound(scene)
    assert np.array_equal(scene.indices, indices)
    for name, values in zip(
        ("positions", "uv0", "uv1", "colors"),
        ("POSITION", "TEXCOORD_0", "TEXCOORD_1", "COLOR_0"),
        strict=True,
    ):
        assert np.array_equal(getattr(scene, name), attributes[values])
    assert np.allclose(scene.normals, attributes["NORMAL"], atol=1e-6)
    assert np.allclose(scene.tangents, attributes["TANGENT"], atol=1e-6)
    assert scene.nodes.names == ["thing"]
    assert scene.mesh_names == ["mesh 0"]
    assert scene.materials[0].name == "default"
    used = attributes["POSITION"][np.unique(indices)].astype(float)
    assert np.allclose(
        scene.bounds, np.stack([used.min(axis=0), used.max(axis=0)]) + np.array((1, 2, 3)), atol=1e-6
    )


@pytest.mark.feature("mesh/bounds")
def test_bounds_hold_the_drawn_vertices_and_touch_them(tmp_path):
    rng = np.random.default_rng(4)
    gltf = Gltf()
    position = gltf.accessor(rng.normal(size=(300, 3)), "f4")
    normal = gltf.accessor(np.tile((0, 0, 1), (300, 1)), "f4")
    for _ in range(5):
        gltf.draw(gltf.primitive(rng.integers(0, 300, 30).astype("u2"), POSITION=position, NORMAL=normal))
    scene = load_scene(gltf.write(tmp_path))
    assert len(scene.positions) == 300  # one block of vertices for all five
    assert scene.meshes["first_vertex"].tolist() == [0] * 5
    for row in scene.meshes:
        drawn = scene.positions[scene.indices[row["first_index"] : row["first_index"] + 30]]
        assert ((drawn >= row["bounds_min"]) & (drawn <= row["bounds_max"])).all()
        assert (drawn == row["bounds_min"]).any(axis=0).all()
        assert (drawn == row["bounds_max"]).any(axis=0).all()
        assert (row["bounds_max"] != scene.positions.max(axis=0)).any(), "not the box of all in the block"


def test_missing_normals_become_flat_and_unshare_vertices(tmp_path):
    positions = np.array([(0, 0, 0), (1, 0, 0), (0, 1, 0), (1, 0, 1)], "f4")
    colors = np.array([(255, 0, 0), (0, 255, 0), (0, 0, 255), (255, 255, 255)], "u1")
    gltf = Gltf()
    color = gltf.accessor(colors, normalized=True)
    gltf.draw(gltf.primitive(np.array([0, 1, 2, 0, 3, 1], "u1"), POSITION=positions, COLOR_0=color))
    scene = load_scene(gltf.write(tmp_path))
    assert np.array_equal(scene.positions, positions[[0, 1, 2, 0, 3, 1]])
    assert np.array_equal(scene.normals, [(0, 0, 1)] * 3 + [(0, 1, 0)] * 3)
    assert np.array_equal(scene.colors[:, :3], colors[[0, 1, 2, 0, 3, 1]] / np.float32(255))
    assert (scene.colors[:, 3] == 1).all()


def test_tangents_are_made_only_where_a_normal_map_asks(tmp_path):
    gltf = Gltf()
    gltf.image(np.full((2, 2, 3), 128, np.uint8))
    gltf.add("textures", {"source": 0})
    gltf.add("materials", {"normalTexture": {"index": 0, "texCoord": 1}})
    gltf.add("materials", {})
    uv = np.array([(0, 1), (0, 0), (1, 0), (1, 1)], "f4")  # u runs along +y, v along -x
    attributes = {
        "POSITION": gltf.accessor(QUAD),
        "NORMAL": gltf.accessor([(0, 0, 1)] * 4, "f4"),
        "TEXCOORD_0": gltf.accessor([(0, 1), (1, 1), (1, 0), (0, 0)], "f4"),
        "TEXCOORD_1": gltf.accessor(np.stack([uv[:, 0] * 0 + QUAD[:, 1], QUAD[:, 0]], axis=1), "f4"),
    }
    for material in (0, 1):
        gltf.draw(gltf.primitive(QUAD_INDICES, material=material, **attributes))
    scene = load_scene(gltf.write(tmp_path))
    with_map, without = scene.meshes["first_vertex"]
    # u along +y and v along +x: the picture's up is -x, so n x t = -x and w = 1.
    assert np.allclose(scene.tangents[with_map : with_map + 4], (0, 1, 0, 1))
    assert not np.allclose(scene.tangents[without : without + 4], (0, 1, 0, 1))
    assert scene.materials[0].normal_texture.uv_set == 1


def test_a_rotated_normal_map_turns_its_tangents(tmp_path):
    """KHR_texture_transform: the tangent runs along the image's u, not the file's."""
    gltf = Gltf()
    gltf.image(np.full((2, 2, 3), 128, np.uint8))
    gltf.add("textures", {"source": 0})
    transform = {"KHR_texture_transform": {"rotation": math.pi / 2}}
    gltf.add("materials", {"normalTexture": {"index": 0, "extensions": transform}})
    uv = np.array([(0, 1), (1, 1), (1, 0), (0, 0)], "f4")
    gltf.draw(
        gltf.primitive(QUAD_INDICES, POSITION=QUAD, NORMAL=[(0, 0, 1.0)] * 4, TEXCOORD_0=uv, material=0)
    )
    scene = load_scene(gltf.write(tmp_path))
    matrix = scene.materials[0].normal_texture.matrix()[:, :2]
    image_uv = uv @ matrix.T
    derivatives = np.linalg.solve(image_uv[[1, 3]] - image_uv[0], QUAD[[1, 3], :2] - QUAD[0, :2])
    assert np.allclose(scene.tangents[:, :2], derivatives[0] / np.linalg.norm(derivatives[0]), atol=1e-6)
    assert np.allclose(np.abs(scene.tangents[:, :2]), (0, 1), atol=1e-6)


def test_bad_normals_tangents_uv_and_colours_are_repaired_with_a_warning(tmp_path):
    nan = np.nan
    gltf = Gltf()
    gltf.draw(
        gltf.primitive(
            QUAD_INDICES,
            POSITION=QUAD,
            NORMAL=np.array([(0, 0, 1), (nan, 0, 0), (0, 0, 0), (0, 0, 3)], "f4"),
            TANGENT=np.array([(1, 0, 0, 1), (0, 0, 0, 1), (nan, 0, 0, 1), (1, 0, 0, nan)], "f4"),
            TEXCOORD_0=np.array([(0, 0), (nan, 0), (np.inf, 0.5), (3e38, 0)], "f4"),
            COLOR_0=np.array([(1, 1, 1), (nan, 0, 0), (-1, 0, np.inf), (0.5, 0, 0)], "f4"),
        )
    )
    scene = load_scene(gltf.write(tmp_path))
    assert_sound(scene)
    assert np.array_equal(scene.normals, [(0, 0, 1)] * 4)
    assert scene.uv0.tolist() == [[0, 0], [0, 0], [0, 0.5], [0, 0]]
    assert scene.colors[:, :3].tolist() == [[1, 1, 1], [1, 0, 0], [0, 0, 1], [0.5, 0, 0]]
    assert len(scene.warnings) == 4


@pytest.mark.parametrize(("integer", "top"), [("i1", 127), ("i2", 32767)])
def test_quantised_attributes(tmp_path, integer, top):
    """KHR_mesh_quantization: positions, normals and uv as small integers."""
    gltf = Gltf()
    gltf.json["extensionsRequired"] = gltf.json["extensionsUsed"] = ["KHR_mesh_quantization"]
    gltf.draw(
        gltf.primitive(
            POSITION=gltf.accessor([(0, 0, 0), (top, 0, 0), (0, -top, 0)], integer, normalized=True),
            NORMAL=gltf.accessor([(0, 0, -top)] * 3, integer, normalized=True),
            TEXCOORD_0=gltf.accessor([(0, 0), (1, 2), (3, 4)], integer),
        )
    )
    scene = load_scene(gltf.write(tmp_path))
    assert scene.positions.tolist() == [[0, 0, 0], [1, 0, 0], [0, -1, 0]]
    assert scene.normals.tolist() == [[0, 0, -1]] * 3
    assert scene.uv0.tolist() == [[0, 0], [1, 2], [3, 4]]
    assert scene.warnings == []


def test_only_what_the_default_scene_draws_is_read(tmp_path):
    gltf = Gltf()
    shown = gltf.draw(gltf.primitive(POSITION=TRIANGLE, material=1))
    gltf.draw(gltf.primitive(POSITION=TRIANGLE, material=0))
    gltf.add("images", {"uri": "missing.png"})
    gltf.add("textures", {"source": 0})
    gltf.add("materials", {"name": "unused", "emissiveTexture": {"index": 0}})
    gltf.add("materials", {"name": "used"})
    gltf.json["scenes"], gltf.json["scene"] = [{"nodes": []}, {"nodes": [shown]}], 1
    scene = load_scene(gltf.write(tmp_path))
    assert len(scene.instances) == len(scene.meshes) == 1
    assert [material.name for material in scene.materials] == ["used"]
    assert scene.images == []


@pytest.mark.parametrize("scenes", [None, [], [{}], [{"nodes": []}]])
def test_a_file_without_anything_to_draw_loads(tmp_path, scenes):
    gltf = Gltf()
    if scenes is not None:
        gltf.json["scenes"] = scenes
    scene = load_scene(gltf.write(tmp_path, "gltf"))
    assert len(scene.instances) == scene.triangle_count == 0
    assert np.array_equal(scene.bounds, np.zeros((2, 3)))
    assert scene.length_scale == 1


def test_other_extensions_are_named_once(tmp_path):
    gltf = triangle()
    gltf.json["extensionsUsed"] = ["KHR_materials_sheen", "KHR_materials_sheen", "KHR_materials_unlit"]
    scene = load_scene(gltf.write(tmp_path))
    assert scene.warnings == ["The extension KHR_materials_sheen is not supported and was ignored."]


def test_files_are_read_without_the_library(tmp_path):
    gltf = triangle()
    for _ in range(6):
        gltf.node(children=[], extras={"empty": []}, weights=[])
    path = gltf.write(tmp_path)
    assert "children" in read_document(path).root["nodes"][5]  # the library drops what is empty
    through_library = read_document(path, use_library=True).root["nodes"][5]
    assert "children" not in through_library
    assert through_library["extras"] == {"empty": []}  # but the user's own data stay as they are


def test_progress_goes_from_0_to_1(tmp_path):
    gltf = Gltf()
    gltf.add("materials", {})
    for number in range(3):
        gltf.image(np.full((4, 4, 3), number, np.uint8))
        gltf.add("textures", {"source": number})
    info = [{"index": number} for number in range(3)]
    gltf.json["materials"][0] = {
        "pbrMetallicRoughness": {"baseColorTexture": info[0]},
        "normalTexture": info[1],
        "emissiveTexture": info[2],
    }
    gltf.draw(gltf.primitive(POSITION=TRIANGLE, material=0))
    steps = []
    load_scene(gltf.write(tmp_path), lambda part, what: steps.append((part, what)))
    parts = [part for part, _ in steps]
    assert parts[0] == 0
    assert parts[-1] == 1
    assert sorted(parts) == parts
    assert len(parts) == 2 + 4
