"""Containers and URIs: what is loaded, and that nothing outside the scene's folder ever is."""

from __future__ import annotations

import base64
import errno
import json
import os
import struct
from pathlib import Path

import numpy as np
import pytest

from common.errors import SceneError
from common.gltf import load_scene
from tests.common.gltf.builder import TRIANGLE, Gltf, pack_glb, triangle


def write_with_uri(folder: Path, uri: str) -> Path:
    gltf = triangle()
    gltf.json["buffers"] = [{"byteLength": len(gltf.data), "uri": uri}]
    path = folder / "scene.gltf"
    path.write_text(gltf.text())
    return path


@pytest.mark.parametrize(
    ("uri", "name"),
    [
        ("a.bin", "a.bin"),
        ("./a.bin", "a.bin"),
        ("data/a.bin", "data/a.bin"),
        ("my%20data.bin", "my data.bin"),
        ("%C3%A4.bin", "ä.bin"),
        ("ä b.bin", "ä b.bin"),
        ("100%.bin", "100%.bin"),
        ("a%20b.bin", "a%20b.bin"),
    ],
)
def test_files_beside_the_scene(tmp_path, uri, name):
    path = tmp_path / name
    path.parent.mkdir(exist_ok=True)
    path.write_bytes(triangle().data)
    assert load_scene(write_with_uri(tmp_path, uri)).triangle_count == 1


@pytest.mark.parametrize(
    "uri",
    [
        "../a.bin",
        "data/../../a.bin",
        "%2e%2e/a.bin",
        "..%2fa.bin",
        "..\\a.bin",
        "..%5ca.bin",
        "/etc/hostname",
        "%2Fetc%2Fhostname",
        "\\\\server\\share\\a.bin",
        "C:/a.bin",
        "C%3A/a.bin",
        "file:///etc/hostname",
        "http://example.org/a.bin",
        "HTTPS://example.org/a.bin",
    ],
)
def test_nothing_outside_the_folder_is_opened(tmp_path, monkeypatch, uri):
    folder = tmp_path / "scene"
    folder.mkdir()
    (tmp_path / "a.bin").write_bytes(triangle().data)
    path = write_with_uri(folder, uri)
    opened = []
    original = os.open
    monkeypatch.setattr(os, "open", lambda file, *rest: opened.append(file) or original(file, *rest))
    with pytest.raises(SceneError, match=r"buffers\[0\]\.uri names .*folder"):
        load_scene(path)
    assert opened == [path]


@pytest.mark.skipif(os.name == "nt", reason="links need a privilege on Windows")
def test_links_that_leave_the_folder_are_refused(tmp_path):
    folder = tmp_path / "scene"
    folder.mkdir()
    (tmp_path / "a.bin").write_bytes(triangle().data)
    (folder / "a.bin").symlink_to(tmp_path / "a.bin")
    with pytest.raises(SceneError, match="a link that leads outside"):
        load_scene(write_with_uri(folder, "a.bin"))
    (folder / "loop.bin").symlink_to(folder / "loop.bin")
    with pytest.raises(SceneError, match=r"buffers\[0\]\.uri"):
        load_scene(write_with_uri(folder, "loop.bin"))
    (folder / "inside.bin").write_bytes(triangle().data)
    (folder / "link.bin").symlink_to("inside.bin")
    assert load_scene(write_with_uri(folder, "link.bin")).triangle_count == 1
    (tmp_path / "other").mkdir()
    (tmp_path / "other" / "a.bin").write_bytes(triangle().data)
    (folder / "below").symlink_to(tmp_path / "other")
    with pytest.raises(SceneError, match="a link that leads outside"):
        load_scene(write_with_uri(folder, "below/a.bin"))
    (tmp_path / "alias").symlink_to(folder)
    assert load_scene(write_with_uri(tmp_path / "alias", "inside.bin")).triangle_count == 1


@pytest.mark.parametrize(
    ("uri", "fault"),
    [
        ("missing.bin", "missing"),
        ("", "no binary chunk"),
        (".", "folder"),
        ("a\0.bin", "names the file|cannot be read"),
        ("x" * 5000 + ".bin", "cannot be read|missing"),
        ("data:application/octet-stream;base64", "without a comma"),
        ("data:;base64,AAA", "not valid base64"),
        ("data:;base64,!!!!", "not valid base64"),
        ("data:;base64,AAAA", "cut short: 3 of 36 bytes"),
        ("data:,abc", "cut short: 3 of 36 bytes"),
        ("empty.bin", "cut short: 0 of 36 bytes"),
    ],
)
def test_uris_without_data(tmp_path, uri, fault):
    (tmp_path / "empty.bin").write_bytes(b"")
    with pytest.raises(SceneError, match=rf"buffers\[0\].*({fault})"):
        load_scene(write_with_uri(tmp_path, uri))


@pytest.mark.parametrize(
    "form", ["data:application/gltf-buffer;base64,{}", "DATA:;BASE64,{}", "data:;base64,{}"]
)
def test_data_uris(tmp_path, form):
    coded = base64.b64encode(triangle().data).decode()
    assert load_scene(write_with_uri(tmp_path, form.format(coded))).triangle_count == 1
    escaped = coded.replace("=", "%3D").replace("/", "%2F")
    assert load_scene(write_with_uri(tmp_path, form.format(escaped))).triangle_count == 1
    percent = "data:," + "".join(f"%{byte:02x}" for byte in triangle().data)
    assert load_scene(write_with_uri(tmp_path, percent)).triangle_count == 1


def test_a_glb_is_known_by_its_bytes_and_may_have_more_chunks(tmp_path):
    data = triangle().glb()
    more = data + struct.pack("<I4s", 4, b"XTRA") + b"1234"
    more = more[:8] + struct.pack("<I", len(more)) + more[12:]
    path = tmp_path / "scene.gltf"
    for content in (data, more, data + b"trailing"):
        path.write_bytes(content)
        assert load_scene(path).triangle_count == 1


@pytest.mark.parametrize("cut", range(1, 104))
def test_a_truncated_glb_is_one_sentence(tmp_path, cut):
    gltf = triangle()
    data = gltf.glb()
    path = tmp_path / "scene.glb"
    path.write_bytes(data[: len(data) * cut // 104])
    with pytest.raises(SceneError) as caught:
        load_scene(path)
    text = str(caught.value)
    assert text.startswith(f"{path}: ")
    assert "\n" not in text
    assert text.endswith(".")


def test_a_glb_whose_parts_lie_about_their_length(tmp_path):
    data = bytearray(triangle().glb())
    path = tmp_path / "scene.glb"
    for offset, value, fault in [
        (4, 1, "says version 1"),
        (8, 2**32 - 1, "cut short"),
        (12, 2**32 - 1, "chunk 0 of the .glb is cut short"),
        (8, 14, "no JSON chunk"),
    ]:
        broken = data.copy()
        struct.pack_into("<I", broken, offset, value)
        path.write_bytes(broken)
        with pytest.raises(SceneError, match=fault):
            load_scene(path)
    path.write_bytes(
        pack_glb(json.dumps({"asset": {"version": "2.0"}}).encode(), b"").replace(b"JSON", b"NOSJ")
    )
    with pytest.raises(SceneError, match="no JSON chunk"):
        load_scene(path)


def test_files_that_are_no_scene(tmp_path):
    def fault(content: bytes | None) -> str:
        path = tmp_path / "x.gltf"
        if content is not None:
            path.write_bytes(content)
        with pytest.raises(SceneError) as caught:
            load_scene(path)
        return str(caught.value).removeprefix(f"{path}: ")

    assert fault(None) == "there is no such file; check the path."
    assert fault(b"") == "the file is empty; export it again."
    assert fault(b"\x89PNG\r\n\x1a\n\xff").startswith("byte 0 is not UTF-8 text")
    assert fault(b"hello").startswith("line 1, column 1 is not valid JSON")
    assert fault(b'{"asset":').startswith("line 1, column 10 is not valid JSON")
    assert fault(b"[]").startswith("the document is a list, not an object")
    assert fault(b"{}").startswith("the document has no asset")
    assert fault(b'{"name": "left-pad", "version": "1.3.0"}').startswith("the document has no asset")
    assert fault(b'{"asset": {"version": "1.0"}}').startswith("asset.version is '1.0'")
    assert fault(b'{"asset": {"version": "2.0", "minVersion": "2.1"}}').startswith(
        "asset.minVersion is '2.1'"
    )
    assert fault(b'{"asset": ' * 100_000).startswith("the JSON is nested too deeply")
    assert fault(b"[" * 100_000).startswith("the JSON is nested too deeply")
    assert fault(b'{"asset": {"version": "2.0"}, "scene": NaN}').startswith(
        "the JSON has a number that cannot"
    )
    assert fault(b'{"asset": {"version": "2.0"}, "scene": ' + b"9" * 5000 + b"}").startswith(
        "the JSON has a number"
    )
    with pytest.raises(SceneError, match="is a folder"):
        load_scene(tmp_path)


def test_bytes_that_nothing_names_are_not_needed(tmp_path):
    gltf = Gltf()
    gltf.draw(gltf.primitive(POSITION=TRIANGLE))
    gltf.json["buffers"] = [{"byteLength": len(gltf.data)}, {"byteLength": 10**12, "uri": "huge.bin"}]
    gltf.add("bufferViews", {"buffer": 1, "byteLength": 10**12})
    assert np.array_equal(load_scene(gltf.write(tmp_path)).positions, TRIANGLE)


def test_an_unreadable_file(tmp_path, monkeypatch):
    def refuse_to_open(_path, *_rest):
        raise PermissionError(errno.EACCES, os.strerror(errno.EACCES))

    path = triangle().write(tmp_path)
    monkeypatch.setattr(os, "open", refuse_to_open)
    with pytest.raises(SceneError, match="Permission denied"):
        load_scene(path)
