"""Only regular files are opened: no pipe, device or folder, and nothing that a link leads to outside a folder."""

from __future__ import annotations

import errno
import os
import socket
import threading

import pytest

from common.environment import read_environment
from common.errors import SceneError, UserError
from common.files.regular_files import leads_outside, open_regular, read_regular
from common.gltf import load_scene
from common.images.ktx import read_ktx
from common.mesh.file import read_mesh_file
from common.mesh.obj import load_obj
from common.scene_graph.file import load_graph
from tests.common.gltf.builder import triangle

posix = pytest.mark.skipif(
    os.name == "nt", reason="Windows names no pipe by a path, and links need a privilege"
)


def test_a_regular_file_is_read_as_it_is(tmp_path):
    data = bytes(range(256)) + b"\r\n\x1a"  # what a text mode would change
    (tmp_path / "file").write_bytes(data)
    assert read_regular(tmp_path / "file") == data
    assert read_regular(tmp_path / "file", 5) == data[:5]
    with open_regular(tmp_path / "file") as stream:
        assert not os.get_inheritable(stream.fileno())
    with pytest.raises(FileNotFoundError):
        open_regular(tmp_path / "missing")
    with pytest.raises(IsADirectoryError):
        open_regular(tmp_path)


@posix
def test_what_is_no_regular_file_is_refused_without_waiting(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    with socket.socket(socket.AF_UNIX) as listening:
        listening.bind(str(tmp_path / "s"))
        for path in (tmp_path / "pipe", tmp_path / "s", "/dev/zero", "/dev/null"):
            with pytest.raises(OSError, match="not a regular file") as caught:
                open_regular(path)
            assert caught.value.errno == errno.EINVAL and caught.value.filename == str(path)


@posix
def test_a_pipe_that_takes_the_place_of_a_file_is_refused(tmp_path, monkeypatch):
    """Between asking for the path and opening it, another program may replace the file: the open file decides."""
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "file").write_bytes(b"")
    as_it_was = os.stat(tmp_path / "file")
    before = len(os.listdir("/proc/self/fd")) if os.path.isdir("/proc/self/fd") else 0
    monkeypatch.setattr(os, "stat", lambda *_: as_it_was)
    ended = threading.Event()

    def opening():
        with pytest.raises(OSError, match="not a regular file"):
            open_regular(tmp_path / "pipe")
        ended.set()

    thread = threading.Thread(target=opening, daemon=True)
    thread.start()
    thread.join(20)
    monkeypatch.undo()
    assert ended.is_set()
    if before:
        assert len(os.listdir("/proc/self/fd")) == before, "the descriptor stayed open"


@posix
def test_links_may_lead_anywhere_inside_the_folder_and_nowhere_else(tmp_path):
    folder = tmp_path / "scene"
    (folder / "sub").mkdir(parents=True)
    (folder / "file").write_bytes(b"")
    (tmp_path / "other").mkdir()
    links = {"same": "file", "sub/up": "../file", "out": "../other", "sub/far": tmp_path, "ring": "ring"}
    for name, target in links.items():
        (folder / name).symlink_to(target)
    (tmp_path / "door").symlink_to(folder)
    outside = {
        name
        for name in (*links, "file", "missing", "out/x", "sub/far/x")
        if leads_outside(folder / name, folder)
    }
    assert outside == {"out", "sub/far", "out/x", "sub/far/x"}
    assert not leads_outside(tmp_path / "door" / "file", tmp_path / "door"), "the folder itself may be a link"
    assert not leads_outside(folder / "a\0b", folder)


READERS = {
    "scene.gltf": (load_scene, SceneError),
    "scene.obj": (load_obj, SceneError),
    "sky.hdr": (read_environment, UserError),
    "t.ktx": (read_ktx, UserError),
    "m.meshes": (read_mesh_file, SceneError),
    "g.graph": (load_graph, SceneError),
}


@posix
@pytest.mark.parametrize("name", READERS)
def test_every_reader_refuses_a_pipe_in_one_sentence(tmp_path, name):
    read, kind = READERS[name]
    os.mkfifo(tmp_path / name)
    with pytest.raises(kind, match="not a regular file") as caught:
        read(tmp_path / name)
    assert str(caught.value).startswith(str(tmp_path / name)) and "\n" not in str(caught.value)


@posix
@pytest.mark.parametrize("kind", ["buffers", "images", "mtllib"])
def test_one_rule_holds_for_all_that_a_scene_names(tmp_path, kind):
    """A pipe, a device and a link that leads outside, named by a buffer, an image or an .obj."""
    folder = tmp_path / "scene"
    folder.mkdir()
    (tmp_path / "secret").write_bytes(bytes(100))
    (folder / "link").symlink_to(tmp_path / "secret")
    os.mkfifo(folder / "pipe")
    faults = {
        "link": "a link that leads outside",
        "pipe": "is not a regular file",
        "/dev/zero": "outside the scene's folder",
        "..%2fsecret": "outside the scene's folder",
    }
    for uri, fault in faults.items():
        if kind == "mtllib":
            (folder / "scene.obj").write_text(f"mtllib {uri}\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
            assert any(fault in text for text in load_obj(folder / "scene.obj").warnings)
            continue
        gltf = triangle()
        if kind == "buffers":
            gltf.json["buffers"] = [{"byteLength": len(gltf.data), "uri": uri}]
        else:
            gltf.add("images", {"uri": uri})
            gltf.add("textures", {"source": 0})
            gltf.add("materials", {"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}})
            gltf.json["meshes"][0]["primitives"][0]["material"] = 0
        path = gltf.write(folder, "glb") if kind == "images" else folder / "scene.gltf"
        if kind == "buffers":
            path.write_text(gltf.text())
        with pytest.raises(SceneError, match=fault):
            load_scene(path)
