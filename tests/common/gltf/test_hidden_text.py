"""Text of a file that cannot be encoded, or would steer a terminal, is written out where it is a name or a note."""

from __future__ import annotations

import dataclasses
import json

import numpy as np
import pytest

from common.errors import SceneError
from common.gltf import load_scene
from common.mesh.obj import load_obj
from tests.common.gltf.builder import TRIANGLE, Gltf, triangle

BAD = "\ud800\x1b[2J\nstrata: all is well\u202e\x00"
SEEN = r"\ud800\x1b[2J\nstrata: all is well\u202e\x00"


def named(text):
    """A scene in which everything that can have a name is called `text`."""
    gltf = Gltf()
    pixels = np.arange(64, dtype=np.uint8).reshape(4, 4, 4)
    gltf.add("textures", {"source": gltf.image(pixels, name=text)})
    gltf.add(
        "materials",
        {"name": text, "pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}, "extras": {text: text}},
    )
    uv = np.array([(0, 0), (1, 0), (0, 1)], "f4")
    mesh = gltf.mesh(gltf.primitive(POSITION=TRIANGLE, TEXCOORD_0=uv, material=0), name=text)
    camera = gltf.add(
        "cameras", {"type": "perspective", "perspective": {"yfov": 1.0, "znear": 0.1}, "name": text}
    )
    gltf.json["extensions"] = {"KHR_lights_punctual": {"lights": [{"type": "point", "name": text}]}}
    gltf.node(mesh=mesh, name=text)
    gltf.node(camera=camera, translation=[0.3, 0.3, 3.0])
    gltf.node(extensions={"KHR_lights_punctual": {"light": 0}}, translation=[0.0, 0.0, 2.0])
    entry = {"input": gltf.accessor([0.0, 1.0], "f4"), "output": gltf.accessor(np.zeros((2, 3), "f4"))}
    channels = [{"sampler": 0, "target": {"node": 0, "path": "translation"}}]
    gltf.add("animations", {"samplers": [entry], "channels": channels, "name": text})
    gltf.json["extensionsUsed"] = ["KHR_lights_punctual", text]
    gltf.json["meshes"][0]["primitives"][0]["attributes"][f"_{text}"] = 0
    gltf.json["meshes"][0]["extras"] = {"targetNames": [text, {text: [text]}]}
    return gltf


def texts_of(scene):
    """Every text of a scene."""
    found = [scene.name, *scene.mesh_names, *scene.nodes.names, *scene.warnings]
    for things in (scene.materials, scene.images, scene.lights, scene.cameras, scene.animations):
        for thing in things:
            values = [getattr(thing, field.name) for field in dataclasses.fields(thing)]
            found += [value for value in values if isinstance(value, str)]
    return found


@pytest.mark.parametrize("form", ["glb", "gltf"])
@pytest.mark.parametrize("use_library", [False, True])
def test_names_are_one_line_that_can_be_encoded(tmp_path, form, use_library):
    texts = texts_of(load_scene(named(BAD).write(tmp_path, form), use_library=use_library))
    assert texts.count(SEEN) >= 6
    for text in texts:
        text.encode()
        assert text.isprintable() and "\n" not in text, text
    assert any(f"The extension {SEEN} is not supported" in text for text in texts)


def test_raw_characters_are_written_out_as_their_escapes_are(tmp_path):
    """JSON may have DEL, C1 and bidi controls as they are."""
    text = "a\x7fb\x9b1mc\u202ed"
    path = tmp_path / "scene.gltf"
    plain = named("NAME").text()
    for data in (plain.replace("NAME", text), plain.replace("NAME", json.dumps(text)[1:-1])):
        root = json.loads(data)
        root["buffers"][0]["uri"] = "scene.bin"
        (tmp_path / "scene.bin").write_bytes(named("NAME").data)
        path.write_text(json.dumps(root, ensure_ascii=data.isascii()), "utf-8")
        assert load_scene(path).mesh_names == [r"a\x7fb\x9b1mc\u202ed"]


def test_names_without_such_characters_stay_as_they_are(tmp_path):
    for text in ("Grüße aus 日本語", r"C:\\new\\table", "tab%09", "👩\u200d🚀"):
        assert load_scene(named(text).write(tmp_path)).mesh_names == [text]


@pytest.mark.parametrize(
    ("uri", "fault"),
    [
        ("\ud800.png", r"names the file \ud800.png, which is missing"),
        ("a\nb.png", r"names the file a\nb.png, which is missing"),
        ("data:image/png,\ud800", "a data URI with characters that are not ASCII"),
        ("data:image/png;base64,\ud800", "a data URI with characters that are not ASCII"),
        ("../\ud800\x1b", r"names '../\ud800\x1b', which is outside"),
        ("file:\u202e", r"names 'file:\u202e', and only files"),
    ],
)
def test_a_uri_is_seen_in_the_sentence_and_used_as_it_is(tmp_path, uri, fault):
    gltf = triangle()
    gltf.add("images", {"uri": uri})
    gltf.add("textures", {"source": 0})
    gltf.add("materials", {"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}})
    gltf.json["meshes"][0]["primitives"][0]["material"] = 0
    with pytest.raises(SceneError) as caught:
        load_scene(gltf.write(tmp_path))
    assert fault in str(caught.value).replace("\\\\", "\\") and str(caught.value).isprintable()


def test_a_file_may_have_any_name_that_its_folder_allows(tmp_path):
    """A URI is text of the file too, and names what it names: here with an escape character in it."""
    gltf = triangle()
    path = gltf.write(tmp_path, "gltf")
    (tmp_path / "scene.bin").rename(tmp_path / "a\x01\u202eb.bin")
    root = json.loads(path.read_text())
    root["buffers"][0]["uri"] = "a\x01\u202eb.bin"
    path.write_text(json.dumps(root))
    assert load_scene(path).triangle_count == 1


def test_keys_that_are_wrong_are_seen(tmp_path):
    gltf = triangle()
    gltf.json["meshes"][0]["primitives"][0]["attributes"]["\x1b\ud800"] = 99
    with pytest.raises(SceneError, match=r"attributes\.\\x1b\\ud800 is 99"):
        load_scene(gltf.write(tmp_path))


def test_wavefront_names(tmp_path):
    path = tmp_path / "a\x1bb.obj"
    (tmp_path / "m.mtl").write_text("newmtl red\x1b[31m\u202e\nKd 1 0 0\n", "utf-8")
    path.write_text(
        "mtllib m.mtl\no tri\x1b[2J\nv 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl red\x1b[31m\u202e\nf 1 2 3\n"
        "usemtl other\x9b\nf 1 2 3\nweird\x1b 1\n",
        "utf-8",
    )
    scene = load_obj(path)
    assert scene.mesh_names == [r"tri\x1b[2J"] * 2 and scene.name == r"a\x1bb"
    assert scene.materials[0].name == r"red\x1b[31m\u202e" and scene.materials[0].base_color[:3] == (1, 0, 0)
    assert all(text.isprintable() for text in texts_of(scene)) and len(scene.warnings) == 2
