"""Places that cannot be written, and scenes that are no place to stand: one sentence, and nothing left behind."""

from __future__ import annotations

import errno
import os
import tempfile

import numpy as np
import pytest

from common.images import read_image
from common.paths import WholeFile, write_whole
from tests.common.gltf.builder import QUAD, QUAD_INDICES, Gltf, triangle
from tests.support import packages

RUN = ("run", "1", "--size", "32x32")


@pytest.mark.parametrize("name", ["x.bmp", "x.hdr", "x", "x.png.jpg"])
def test_what_is_advised_is_taken(strata, tmp_path, name):
    code, _, err = strata(*RUN, "--scene", triangle().write(tmp_path), "--out", name)
    assert code == 2 and err == f"strata: {name} cannot be written as a picture: name .png or .exr\n"


def test_a_folder_is_called_one(strata, tmp_path):
    scene = triangle().write(tmp_path)
    for name in ("folder", "folder.png"):
        (tmp_path / name).mkdir()
        code, _, err = strata(*RUN, "--scene", scene, "--out", name)
        assert code == 2 and err.startswith(f"strata: {name} is a folder: name a file in it, such as {name}")
    advised = err.split("such as ")[1].strip()
    assert strata(*RUN, "--scene", scene, "--out", advised)[0] == 0 and (tmp_path / advised).is_file()


@pytest.mark.parametrize("name", ["x[/b]", "[bold]x", "x[red", "[link=a]b[/link]"])
def test_a_folder_may_have_any_name(strata, tmp_path, name):
    code, out, err = strata("convert", triangle().write(tmp_path), name)
    assert code == 0, err
    assert f"scene in {name}" in " ".join(out.split()).replace(
        "scene in " + name.replace(" ", ""), f"scene in {name}"
    )
    assert (tmp_path.joinpath(*name.split("/")) / "scene.json").is_file()


class Full:
    """A disk on which only so many files find room."""

    def __init__(self, monkeypatch, room):
        self.room = room
        real = WholeFile.keep

        def keep(file):
            if self.room == 0:
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))  # as write(2) does: it names no file
            self.room -= 1
            real(file)

        monkeypatch.setattr(WholeFile, "keep", keep)


def test_a_full_disk_is_told_with_the_path(tmp_path, monkeypatch):
    Full(monkeypatch, 0)
    with pytest.raises(OSError, match="No space left") as caught:
        write_whole(tmp_path / "a", b"data")
    assert caught.value.filename == str(tmp_path / "a") and caught.value.errno == errno.ENOSPC
    assert list(tmp_path.iterdir()) == []


def test_a_folder_that_takes_no_file_is_told_with_the_path(tmp_path, monkeypatch):
    """Making the temporary file fails as well, and names that."""

    def refused(**_):
        raise PermissionError(errno.EACCES, os.strerror(errno.EACCES), str(tmp_path / ".a.xyz"))

    monkeypatch.setattr(tempfile, "mkstemp", refused)
    with pytest.raises(PermissionError) as caught:
        write_whole(tmp_path / "a", b"data")
    assert caught.value.filename == str(tmp_path / "a")


def textured(tmp_path):
    """A scene with a picture, so that a conversion writes six files."""
    gltf = Gltf()
    texture = gltf.add("textures", {"source": gltf.image(np.full((4, 4, 4), 255, np.uint8))})
    material = gltf.add("materials", {"pbrMetallicRoughness": {"baseColorTexture": {"index": texture}}})
    gltf.draw(gltf.primitive(QUAD_INDICES, POSITION=QUAD, TEXCOORD_0=QUAD[:, :2], material=material))
    return gltf.write(tmp_path)


@pytest.mark.parametrize("room", range(6))
@pytest.mark.parametrize("there", [False, True])
def test_a_conversion_to_a_full_disk_leaves_no_folder(strata, tmp_path, monkeypatch, room, there):
    scene, target = textured(tmp_path), tmp_path / "new" / "files"
    if there:
        target.mkdir(parents=True)
        (target / "mine").write_text("stays")
    Full(monkeypatch, room)
    code, _, err = strata("convert", scene, target)
    assert code == 2
    (line,) = err.splitlines()
    assert (
        line.startswith(f"strata: {target}")
        and "cannot be written" in line
        and "No space left on device" in line
    )
    if there:
        assert (target / "mine").read_text() == "stays" and not (target / "scene.json").exists()
        assert not (target / "textures").exists() or room > 0
    else:
        assert {path.name for path in tmp_path.iterdir()} == {scene.name}


def test_a_conversion_that_fits_is_whole(strata, tmp_path, monkeypatch):
    scene = textured(tmp_path)
    Full(monkeypatch, 6)
    assert strata("convert", scene, "files")[0] == 0
    assert len([path for path in (tmp_path / "files").rglob("*") if path.is_file()]) == 6


@pytest.mark.parametrize("backend", packages.BACKENDS)
def test_a_scene_far_away_is_no_fault_of_the_code(strata, tmp_path, backend):
    gltf = triangle()
    gltf.json["nodes"][0].update(translation=[1e17, 1e17, 1e17], scale=[5.0] * 3)
    path = gltf.write(tmp_path)
    code, _, err = strata(*RUN, "--backend", backend, "--scene", path, "--out", "a.png")
    assert code == 0 and "m from its origin, where places are rounded to 16 m" in err and "Warning" not in err


@pytest.mark.parametrize("backend", packages.BACKENDS)
@pytest.mark.parametrize("chapter", [1, 2])
def test_a_texture_without_coordinates_is_drawn_as_its_texel_at_zero(strata, tmp_path, backend, chapter):
    """The same picture as one texture of that colour alone."""
    pictures = []
    for case in ("absent", "one colour"):
        pixels = np.full((4, 4, 4), 255, np.uint8)
        pixels[..., :3] = (0, 255, 0) if case == "absent" else (255, 0, 0)
        pixels[0, 0, :3] = (255, 0, 0)
        gltf = Gltf()
        sampler = gltf.add("samplers", {"magFilter": 9728, "minFilter": 9728, "wrapS": 33071, "wrapT": 33071})
        texture = gltf.add("textures", {"source": gltf.image(pixels), "sampler": sampler})
        info = {"index": texture, "texCoord": 1 if case == "absent" else 0}
        material = gltf.add("materials", {"pbrMetallicRoughness": {"baseColorTexture": info}})
        uv = np.array([(0, 0), (1, 0), (1, 1), (0, 1)], "f4")
        gltf.draw(gltf.primitive(QUAD_INDICES, POSITION=QUAD, TEXCOORD_0=uv, material=material))
        command = (
            "run",
            str(chapter),
            "--backend",
            backend,
            "--size",
            "32x32",
            "--scene",
            gltf.write(tmp_path),
        )
        code, _, err = strata(*command, "--out", "a.png")
        assert code == 0 and ("has no TEXCOORD_1, which materials[0] samples" in err) == (case == "absent"), (
            err
        )
        pictures.append(read_image(tmp_path / "a.png"))
    assert (pictures[0] == pictures[1]).all() and len(np.unique(pictures[0])) > 1


def test_an_examination_says_it_too(strata, tmp_path, monkeypatch):
    monkeypatch.setenv("STRATA_ASSETS", str(tmp_path / "models"))
    monkeypatch.setenv("STRATA_CACHE", str(tmp_path / "cache"))
    gltf = Gltf()
    texture = gltf.add("textures", {"source": gltf.image(np.full((4, 4, 4), 255, np.uint8))})
    info = {"index": texture, "texCoord": 1}
    material = gltf.add("materials", {"pbrMetallicRoughness": {"baseColorTexture": info}})
    normals = np.tile((0, 0, 1), (4, 1)).astype("f4")
    gltf.draw(gltf.primitive(QUAD_INDICES, POSITION=QUAD, NORMAL=normals, material=material))
    code, out, err = strata("assets", "add", gltf.write(tmp_path), "--name", "bare")
    assert code == 0, err
    assert "has no TEXCOORD_1" in out and "All of it is drawn" not in out
