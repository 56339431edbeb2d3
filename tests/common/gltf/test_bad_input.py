"""What is wrong with a file is one sentence that names file, place, fault and what to do; and never more than that."""

from __future__ import annotations

import re
import warnings
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from common.errors import SceneError
from common.gltf import load_scene
from common.paths import asset_dir
from tests.common.gltf.builder import QUAD, QUAD_INDICES, TRIANGLE, Gltf, triangle

ASSETS = asset_dir()
MALFORMED = sorted(ASSETS.glob("malformed/*/*.gl*")) if ASSETS else []
EXPECTED = {
    "AllIndicesOutOfRange": "has index 65535 at position 0, but there are only 24 vertices",
    "BoxBadNormals": None,  # loads, with its normals made anew
    "BoxTextured": "names the file CesiumLogoFlat.png, which is missing",
    "IndexOutOfRange": "has index 255 at position 0, but there are only 24 vertices",
    "sceneWrongType": "scene is 'hello', not a place in scenes",
}


def sentence_of(path: Path, use_library: bool = False) -> str:
    """Load a file that must be refused; returns the sentence without the file's name."""
    with pytest.raises(SceneError) as caught:
        load_scene(path, use_library=use_library)
    text = str(caught.value)
    assert text.startswith(f"{path}: ") and text.endswith(".") and "\n" not in text and len(text) <= 600
    assert (
        caught.value.exit_code == 2 and caught.value.__cause__ is None and caught.value.__suppress_context__
    )
    sentence = text.removeprefix(f"{path}: ")
    assert re.fullmatch(r"[^;].+; .+\.", sentence), "a fault, and after it what to do"
    return sentence


@pytest.mark.skipif(ASSETS is None, reason="no models; set STRATA_ASSETS")
def test_no_malformed_file_is_left_out():
    assert {path.stem for path in MALFORMED} == EXPECTED.keys()


@pytest.mark.feature("scene/gltf-loader")
@pytest.mark.parametrize("path", MALFORMED, ids=[path.stem for path in MALFORMED])
def test_malformed_files(path, capfd):
    fault = EXPECTED[path.stem]
    if fault is None:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            scene = load_scene(path)
        assert scene.triangle_count == 12 and len(scene.warnings) == 1
        assert np.allclose(np.linalg.norm(scene.normals, axis=1), 1, atol=1e-6)
    else:
        assert fault in sentence_of(path)
    assert capfd.readouterr() == ("", "")


def broken(change: Callable[[Gltf], object]) -> Gltf:
    """A quad with a parent, a camera and a light, and one thing wrong."""
    gltf = Gltf()
    child = gltf.draw(
        gltf.primitive(QUAD_INDICES, POSITION=QUAD, NORMAL=np.tile((0, 0, 1), (4, 1)).astype("f4"))
    )
    gltf.node(children=[child])
    change(gltf)
    return gltf


def put(*keys: str | int, value: object) -> Callable[[Gltf], None]:
    """Return a change that sets one place of the document."""

    def change(gltf: Gltf) -> None:
        place = gltf.json
        for key in keys[:-1]:
            place = place[key]
        place[keys[-1]] = value

    return change


def position(value: float) -> Callable[[Gltf], None]:
    """Return a change of the y of vertex 1."""

    def change(gltf: Gltf) -> None:
        view = gltf.json["accessors"][primitive(gltf)["POSITION"]]["bufferView"]
        start = gltf.json["bufferViews"][view]["byteOffset"] + 16
        gltf.data[start : start + 4] = np.float32(value).tobytes()

    return change


def primitive(gltf: Gltf) -> dict[str, int]:
    return gltf.json["meshes"][0]["primitives"][0]["attributes"]


def animation(
    gltf: Gltf, times: list[float], values: np.ndarray, path: str = "translation", **sampler: str
) -> None:
    entry = {"input": gltf.accessor(times, "f4"), "output": gltf.accessor(values, "f4"), **sampler}
    channel = {"sampler": 0, "target": {"node": 0, "path": path}}
    gltf.add("animations", {"samplers": [entry], "channels": [channel]})


def skin(gltf: Gltf, joint: int, weight: float = 1.0, **entry: object) -> None:
    part = gltf.primitive(
        POSITION=TRIANGLE,
        JOINTS_0=np.full((3, 4), joint, "u1"),
        WEIGHTS_0=np.full((3, 4), weight / 4, "f4"),
    )
    number = gltf.add("skins", {"joints": [0, 1], **entry})
    gltf.draw(part, skin=number)


BROKEN = {
    "a node that is its own child": (
        put("nodes", 0, "children", value=[0]),
        "nodes[0].children[0] names the node",
    ),
    "nodes in a circle": (put("nodes", 0, "children", value=[1]), "lead back to the node itself"),
    "two parents": (lambda g: g.node(children=[0]), "already a child of node 1"),
    "a child that is not there": (put("nodes", 1, "children", value=[7]), "nodes[1].children[0] is 7"),
    "a position that is NaN": (
        position(np.nan),
        "POSITION (accessors[1]) has a number that is not finite in element 1",
    ),
    "a position that is infinite": (position(-np.inf), "not finite in element 1"),
    "a position beyond all": (position(1e30), "a number beyond 1e18 in element 1"),
    "indices out of range": (
        lambda g: put("meshes", 0, "primitives", 0, "indices", value=g.accessor([0, 1, 4], "u2"))(g),
        "indices has index 4 at position 2, but there are only 4 vertices",
    ),
    "an accessor beyond its view": (put("accessors", 1, "count", value=5), "accessors[1] ends at byte 60"),
    "a count beyond all": (put("accessors", 1, "count", value=2**52), "accessors[1] ends at byte"),
    "a view beyond its buffer": (
        put("bufferViews", 0, "byteLength", value=10**9),
        "bufferViews[0] ends at byte",
    ),
    "a buffer without data": (put("buffers", value=[{"byteLength": 10**6}]), "buffers[0] is cut short"),
    "an accessor that is not there": (
        put("meshes", 0, "primitives", 0, "indices", value=9),
        "is 9, but there are",
    ),
    "a mode that does not exist": (
        put("meshes", 0, "primitives", 0, "mode", value=7),
        "is 7, not one of 0, 1",
    ),
    "a number that is a text": (put("nodes", 0, "translation", value=["1", 0, 0]), "translation[0] is '1'"),
    "a list that is an object": (put("meshes", value={}), "meshes is an object"),
    "true for one": (put("nodes", 0, "mesh", value=True), "nodes[0].mesh is True"),
    "a rotation that is none": (put("nodes", 0, "rotation", value=[0, 0, 0, 0]), "nodes[0].rotation is zero"),
    "a projective matrix": (put("nodes", 0, "matrix", value=[1] * 16), "last row other than 0 0 0 1"),
    "matrices of too few numbers": (put("nodes", 0, "matrix", value=[1] * 12), "nodes[0].matrix"),
    "attributes of two lengths": (
        lambda g: primitive(g).update(NORMAL=g.accessor(TRIANGLE)),
        "NORMAL has 3 elements, but POSITION has 4",
    ),
    "an attribute of the wrong type": (
        lambda g: primitive(g).update(TEXCOORD_0=g.accessor(QUAD)),
        "TEXCOORD_0 (accessors[3]) is VEC3 instead of VEC2",
    ),
    "a required extension": (
        put("extensionsRequired", value=["KHR_draco_mesh_compression"]),
        "names KHR_draco_mesh_compression, which Strata does not support; export it without Draco",
    ),
    "an unheard-of required extension": (
        put("extensionsRequired", value=["KHR_texture_transform", "ACME_teapots"]),
        "names ACME_teapots, which",
    ),
    "a file outside the folder": (
        put("images", value=[{"uri": "../../secret.png"}]),
        None,  # nobody uses the image
    ),
    "times that go back": (lambda g: animation(g, [0, 2, 1], np.zeros((3, 3))), "goes backwards after key 1"),
    "too few keys": (
        lambda g: animation(g, [0, 1], np.zeros((3, 3))),
        "has 3 elements instead of 2 for 2 keys",
    ),
    "too few cubic keys": (
        lambda g: animation(g, [0, 1], np.zeros((2, 3)), interpolation="CUBICSPLINE"),
        "has 2 elements instead of 6",
    ),
    "a key that is no rotation": (
        lambda g: animation(g, [0], np.zeros((1, 4)), "rotation"),
        "zero quaternion",
    ),
    "a time that is NaN": (lambda g: animation(g, [0, np.nan], np.zeros((2, 3))), "not finite in element 1"),
    "an interpolation that does not exist": (
        lambda g: animation(g, [0], np.zeros((1, 3)), interpolation="SMOOTH"),
        "interpolation is 'SMOOTH'",
    ),
    "a joint that is not there": (lambda g: skin(g, 2), "names joint 2, but the skin has 2"),
    "a negative weight": (lambda g: skin(g, 0, -1.0), "negative weight at vertex 0"),
    "a skin without joints": (lambda g: skin(g, 0, joints=[]), "skins[0].joints is empty"),
    "too few matrices": (
        lambda g: skin(g, 0, inverseBindMatrices=g.accessor(np.eye(4, dtype="f4").reshape(1, 16))),
        "has 1 matrices for 2 joints",
    ),
    "morph weights of another number": (
        put("meshes", 0, "weights", value=[1.0]),
        "has 1 elements for 0 morph",
    ),
    "a camera without height": (
        lambda g: g.node(
            camera=g.add(
                "cameras",
                {"type": "orthographic", "orthographic": {"xmag": 1, "ymag": 0, "znear": 0, "zfar": 1}},
            )
        ),
        "ymag is 0",
    ),
    "a field of view of a half turn": (
        lambda g: g.node(
            camera=g.add("cameras", {"type": "perspective", "perspective": {"yfov": 3.2, "znear": 0.1}})
        ),
        "yfov is 3.2, not an angle",
    ),
    "a scene as large as the universe": (put("nodes", 0, "scale", value=[1e18, 1, 1]), None),
    "nodes that multiply beyond all": (
        lambda g: (
            put("nodes", 0, "scale", value=[1e18] * 3)(g),
            put("nodes", 1, "scale", value=[1e18] * 3)(g),
        ),
        "reaches further than 1e+18 m",
    ),
}


@pytest.mark.parametrize("name", BROKEN)
def test_what_is_wrong_is_named(tmp_path, name):
    change, fault = BROKEN[name]
    path = broken(change).write(tmp_path)
    if fault is None:
        load_scene(path)
    else:
        assert fault in sentence_of(path)
        assert sentence_of(path, use_library=False) == sentence_of(path, use_library=True)


@pytest.mark.parametrize("value", [0.0, np.nan, np.inf])
def test_normals_without_a_direction_are_made_anew(tmp_path, value):
    normals = np.tile((0, 0, 1), (4, 1)).astype("f4")
    normals[2] = value
    gltf = Gltf()
    gltf.draw(gltf.primitive(QUAD_INDICES, POSITION=QUAD, NORMAL=normals))
    scene = load_scene(gltf.write(tmp_path))
    assert np.array_equal(scene.normals, np.tile((0, 0, 1), (4, 1)))
    assert scene.warnings == ["meshes[0].primitives[0] has normals without a direction; they were made anew."]


@pytest.mark.parametrize("value", [(0.0, 0.0, 0.0, 1.0), (np.nan, 0.0, 0.0, 1.0), (1.0, 0.0, 0.0, np.inf)])
def test_one_tangent_without_a_direction_makes_all_of_them_anew(tmp_path, value):
    """The file's tangents run along y. Without them they run along x, and the good ones go with the bad one."""
    tangents = np.tile((0, 1, 0, 1), (4, 1)).astype("f4")
    normals = np.tile((0, 0, 1), (4, 1)).astype("f4")

    def loaded():
        gltf = Gltf()
        gltf.draw(gltf.primitive(QUAD_INDICES, POSITION=QUAD, NORMAL=normals, TANGENT=tangents))
        return load_scene(gltf.write(tmp_path))

    whole = loaded()
    assert np.array_equal(whole.tangents, tangents) and not whole.warnings
    tangents[2] = value
    mended = loaded()
    assert mended.warnings == [
        "meshes[0].primitives[0] has tangents without a direction; all of its tangents were made anew."
    ]
    assert np.array_equal(mended.tangents[:, :3], np.tile((1, 0, 0), (4, 1)))


def test_a_missing_file_is_answered_with_a_near_name(tmp_path):
    path = triangle().write(tmp_path, "gltf")
    assert sentence_of(tmp_path / "scne.gltf") == (
        "there is no such file; check the path, or name 'scene.gltf', which is there."
    )
    assert sentence_of(tmp_path / "other" / "scene.gltf") == "there is no such file; check the path."
    (tmp_path / "scene.bin").rename(tmp_path / "Scene.BIN")
    assert sentence_of(path) == (
        "buffers[0].uri names the file scene.bin, which is missing; put it beside the scene, "
        "or name 'Scene.BIN', which is there."
    )
    (tmp_path / "Scene.BIN").rename(tmp_path / "quite different")
    assert sentence_of(path).endswith("missing; put it beside the scene.")


def test_a_folder(tmp_path):
    assert sentence_of(tmp_path) == "is a folder; name the .gltf or .glb in it."
    (tmp_path / "scene.bin").mkdir()
    gltf = triangle()
    gltf.json["buffers"] = [{"byteLength": len(gltf.data), "uri": "scene.bin"}]
    (tmp_path / "scene.gltf").write_text(gltf.text())
    assert "names a folder" in sentence_of(tmp_path / "scene.gltf")


def test_names_from_the_file_cannot_reach_the_terminal(tmp_path):
    gltf = triangle()
    gltf.json["extensionsRequired"] = ["\x1b[2J\nEVIL" + "x" * 5000]
    sentence = sentence_of(gltf.write(tmp_path))
    assert "\x1b" not in sentence and "EVIL" in sentence


def test_a_long_chain_of_nodes(tmp_path):
    """Depth is no recursion: a long chain loads, and one closed to a ring is refused."""
    gltf = triangle()
    gltf.json["nodes"] += [{"children": [number]} for number in range(20_000)]
    assert len(load_scene(gltf.write(tmp_path)).nodes) == 20_001
    gltf.json["nodes"][0]["children"] = [20_000]
    assert "lead back" in sentence_of(gltf.write(tmp_path))
