"""`strata run` from chapter 3 on keeps scenes: what it says of that, and the options that change it."""

from __future__ import annotations

import errno
import io
import os

import numpy as np
import pytest
from PIL import Image

from chapters.ch03.scene_cache import sections
from chapters.ch03.scene_cache.cache import open_scene
from common.images import read_image
from tests.common.gltf.builder import TRIANGLE, Gltf, triangle
from tools.run.opening import Opening


@pytest.fixture
def scene(tmp_path, monkeypatch):
    """The file of a small scene, and an empty cache."""
    monkeypatch.setenv("STRATA_CACHE", str(tmp_path / "cache"))
    return triangle().write(tmp_path)


def run(strata, scene, *more):
    """Draw the scene with chapter 3; return the picture and what was said."""
    code, _, err = strata("run", "3", "--scene", scene, "--size", "32x24", "--out", "a.png", *more)
    assert code == 0, err
    return read_image(scene.parent / "a.png"), err


def kept(scene):
    folder = scene.parent / "cache" / "scene-cache"
    return sorted(file.suffix for file in folder.iterdir()) if folder.is_dir() else []


def test_the_second_run_opens_what_the_first_one_kept(strata, scene):
    first, told = run(strata, scene, "-v")
    assert "since it had no cache" in told and "It is cached in" in told
    second, told = run(strata, scene, "-v")
    assert "from its cache" in told and "It is cached" not in told
    assert (first == second).all() and kept(scene) == [".texels"]
    _, told = run(strata, scene)
    assert told.count("\n") == 1  # without -v nothing is said of it


def test_without_a_cache_nothing_is_kept(strata, scene):
    _, told = run(strata, scene, "--no-cache", "-v")
    assert "without a cache" in told and kept(scene) == []


@pytest.mark.needs("etcpak")
def test_a_compressed_cache_is_asked_for(strata, scene):
    run(strata, scene, "--compress")
    assert kept(scene) == [".blocks"]


def test_options_that_cannot_be_meant_are_refused(strata, scene):
    code, _, err = strata("run", "3", "--scene", scene, "--compress", "--no-cache")
    assert code == 2 and "cannot both be meant" in err and err.count("\n") == 1
    code, _, err = strata("run", "1", "--scene", scene, "--compress", "--headless")
    assert code == 2 and "Chapter 1 keeps no scenes" in err and err.count("\n") == 1


def test_chapters_without_a_cache_keep_nothing(strata, scene):
    code, _, err = strata(
        "run", "1", "--scene", scene, "--size", "32x24", "--out", "a.png", "--no-cache", "-v"
    )
    assert code == 0 and "cache" not in err and kept(scene) == []


def test_a_full_disk_is_one_sentence(strata, scene, monkeypatch):
    def full(*_):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(sections.SectionWriter, "add", full)
    _, told = run(strata, scene)
    assert told.count("\n") == 2 and "No space left on device" in told and kept(scene) == []


def test_a_scene_without_pictures_is_kept_by_a_thread_beside_the_window(scene):
    opened = open_scene(scene)
    with Opening(opened.scene, opened.told, opened.writer) as opening:
        opening.start()
        opening.writer.finish()
    assert kept(scene) == [".texels"]


def test_wavefront_files_are_loaded_plainly(strata, scene):
    file = scene.parent / "a.obj"
    file.write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    code, _, err = strata("run", "3", "--scene", file, "--size", "32x24", "--out", "a.png", "-v")
    assert code == 0, err
    assert kept(scene) == []


@pytest.mark.parametrize("backend", ["vulkan", pytest.param("gl", marks=pytest.mark.needs("moderngl"))])
def test_a_texture_that_fails_while_frames_are_drawn_is_named_behind_them(
    strata, tmp_path, monkeypatch, backend
):
    monkeypatch.setenv("STRATA_CACHE", str(tmp_path / "cache"))
    stream = io.BytesIO()
    Image.fromarray(np.random.default_rng(1).integers(0, 256, (9, 9, 4), np.uint8)).save(stream, "PNG")
    gltf = Gltf()
    view = gltf.view(stream.getvalue()[:-40])
    gltf.add("textures", {"source": gltf.add("images", {"bufferView": view, "mimeType": "image/png"})})
    gltf.add("materials", {"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}})
    uv = np.zeros((3, 2), "f4")
    gltf.draw(gltf.primitive(POSITION=TRIANGLE, TEXCOORD_0=uv, material=0))
    path = gltf.write(tmp_path)
    words = ("--backend", backend, "--frames", "60", "--no-cache", "--set", "loading=stream")
    _, told = run(strata, path, *words)
    assert "images[0]" in told and "is drawn without its texture" in told
    code, _, err = strata("run", "3", "--scene", path, "--size", "32x24", "--out", "b.png", "--no-cache")
    assert code == 2 and "images[0]" in err and err.count("\n") == 1
