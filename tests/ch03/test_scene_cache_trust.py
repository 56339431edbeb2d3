"""A scene cache is never trusted: damaged, cut short, foreign or stale it is made anew; no disk stops a scene."""

from __future__ import annotations

import errno
import json
import os
import subprocess
import sys

import numpy as np
import pytest

from chapters.ch03.scene_cache import cache as scene_cache
from chapters.ch03.scene_cache import sections, sources
from chapters.ch03.scene_cache.cache import CacheMiss, cache_file, open_scene, read_cache
from chapters.ch03.scene_cache.sections import DamagedError, SectionFile, SectionWriter
from common import paths
from common.gltf import load_scene
from common.paths import ROOT
from tests.common.gltf.builder import TRIANGLE, Gltf
from tests.support.scene_equality import difference

validity = pytest.mark.feature("scene-cache/validity")


@pytest.fixture(autouse=True)
def cache(tmp_path, monkeypatch):
    """A cache of its own, empty."""
    monkeypatch.setenv("STRATA_CACHE", str(tmp_path / "cache"))
    return tmp_path / "cache" / scene_cache.FOLDER


def textured(folder):
    """Write a triangle with a picture of 4 x 4."""
    gltf = Gltf()
    pixels = np.arange(64, dtype=np.uint8).reshape(4, 4, 4)
    gltf.add("textures", {"source": gltf.image(pixels)})
    gltf.add("materials", {"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}})
    uv = np.array([(0, 0), (1, 0), (0, 1)], "f4")
    gltf.draw(gltf.primitive(POSITION=TRIANGLE, TEXCOORD_0=uv, material=0))
    return gltf.write(folder, "gltf")


def write(path):
    """Cache the scene of a file; return the cache."""
    opened = open_scene(path)
    opened.writer.finish()
    assert opened.writer.told.startswith("It is cached"), opened.writer.told
    return cache_file(path)


def everything(target, path):
    """Read all that a cache holds."""
    scene = read_cache(target, path)
    before = list(scene.warnings)
    for image in scene.images:
        _ = image.pixels
    return scene, scene.warnings[len(before) :]


@validity
def test_one_flipped_byte_is_noticed_wherever_it_is(tmp_path):
    path = textured(tmp_path)
    whole = write(path).read_bytes()
    target, source = cache_file(path), load_scene(path)
    rng = np.random.default_rng(1)
    ends = [*range(70), *range(len(whole) - 50, len(whole))]
    noticed = {"miss": 0, "picture": 0}
    for place in sorted({*ends, *rng.integers(0, len(whole), 250).tolist()}):
        data = bytearray(whole)
        data[place] ^= 1 << int(rng.integers(8))
        target.write_bytes(data)
        try:
            scene, warnings = everything(target, path)
        except CacheMiss:
            noticed["miss"] += 1
            continue
        # Of pictures it is noticed when they are asked for; then they come from the source.
        assert len(warnings) == 1 and "damaged" in warnings[0], f"byte {place} of {len(whole)}"
        assert not target.exists()
        scene.warnings.clear()
        assert difference(source, scene) == ""
        noticed["picture"] += 1
    assert noticed["miss"] > 200 and noticed["picture"] > 0


@pytest.mark.feature("scene-cache/file")
@validity
def test_a_file_cut_short_anywhere_is_refused(tmp_path):
    path = textured(tmp_path)
    target = write(path)
    whole = target.read_bytes()
    for length in [*range(200), *range(200, len(whole), 37), *range(len(whole) - 60, len(whole))]:
        target.write_bytes(whole[:length])
        with pytest.raises(CacheMiss):
            read_cache(target, path)
    target.write_bytes(whole + b"\0")
    with pytest.raises(CacheMiss):
        read_cache(target, path)


@validity
def test_what_was_refused_is_made_anew(tmp_path):
    path = textured(tmp_path)
    target = write(path)
    whole = target.read_bytes()
    target.write_bytes(whole[:-1])
    opened = open_scene(path)
    assert "damaged end, or was cut short" in opened.told
    assert difference(load_scene(path).positions, opened.scene.positions) == ""
    opened.writer.finish()
    assert open_scene(path).writer is None
    assert len(target.read_bytes()) == len(whole)


@validity
def test_another_version_of_the_program_makes_its_own(tmp_path, monkeypatch):
    path = textured(tmp_path)
    target = write(path)
    monkeypatch.setattr(scene_cache, "maker", lambda: "another")
    with pytest.raises(CacheMiss, match="another version"):
        read_cache(target, path)
    monkeypatch.undo()
    monkeypatch.setattr(sections, "VERSION", sections.VERSION + 1)
    with pytest.raises(DamagedError, match="version"):
        SectionFile(target)


@validity
def test_the_cache_of_another_scene_is_refused(tmp_path):
    one, other = tmp_path / "one", tmp_path / "other"
    one.mkdir(), other.mkdir()
    first, second = textured(one), textured(other)
    write(second).replace(cache_file(first))
    with pytest.raises(CacheMiss, match="another file"):
        read_cache(cache_file(first), first)


@validity
@pytest.mark.parametrize("name", ["scene.gltf", "scene.bin"])
def test_other_content_of_the_same_size_and_time_is_noticed(tmp_path, name):
    path = textured(tmp_path)
    target = write(path)
    changed = tmp_path / name
    before = changed.stat()
    data = bytearray(changed.read_bytes())
    place = data.index(b'"byteLength"') - 1 if name.endswith("gltf") else 0
    data[place] ^= 0x21
    changed.write_bytes(data)
    os.utime(changed, ns=(before.st_atime_ns, before.st_mtime_ns))
    with pytest.raises(CacheMiss, match="changed since"):
        read_cache(target, path)


def test_files_that_were_copied_or_touched_are_still_the_same(tmp_path):
    path = textured(tmp_path)
    target = write(path)
    data = (tmp_path / "scene.bin").read_bytes()
    (tmp_path / "scene.bin").unlink()
    (tmp_path / "scene.bin").write_bytes(data)
    os.utime(path, (1e9, 1e9))
    read_cache(target, path)


def test_a_file_that_went_missing_is_noticed(tmp_path):
    path = textured(tmp_path)
    target = write(path)
    (tmp_path / "scene.bin").unlink()
    with pytest.raises(CacheMiss):
        read_cache(target, path)


def test_content_is_not_read_again_where_nobody_can_have_written(tmp_path, monkeypatch):
    path = textured(tmp_path)
    monkeypatch.setattr(sources, "RACY_NS", -(10**12))  # as if all had been written long ago
    target = write(path)
    monkeypatch.setattr(sources, "digest", lambda _: pytest.fail("a file was read"))
    read_cache(target, path)


def test_what_was_written_just_before_is_read_again(tmp_path, monkeypatch):
    path = textured(tmp_path)
    target = write(path)
    asked = []
    monkeypatch.setattr(sources, "digest", lambda file: asked.append(file.name) or "")
    with pytest.raises(CacheMiss):
        read_cache(target, path)
    assert sorted(asked) == ["scene.bin", "scene.gltf"]


def test_a_file_that_changes_while_it_loads_is_not_cached(tmp_path, cache):
    path = textured(tmp_path)
    opened = open_scene(path)
    with (tmp_path / "scene.bin").open("ab") as stream:
        stream.write(b"more")
    opened.writer.finish()
    assert opened.writer.failed and "scene.bin changed" in opened.writer.told
    assert opened.writer.told.count(".") == 2  # one sentence, and the name of a file
    assert not list(cache.iterdir())


def test_sizes_that_the_file_does_not_have_are_refused_before_anything_is_read(tmp_path):
    writer = SectionWriter(tmp_path / "file")
    writer.add(np.arange(6, dtype=np.float32).reshape(2, 3))
    writer._rows[0] = (*writer._rows[0][:4], [2**40, 3])
    writer.keep({})
    with pytest.raises(DamagedError, match="another size"):
        SectionFile(tmp_path / "file")
    writer = SectionWriter(tmp_path / "file")
    writer.add(np.arange(6, dtype=np.float32))
    writer._rows[0] = (2**60, *writer._rows[0][1:])
    writer.keep({})
    with pytest.raises(DamagedError, match="do not lie"):
        SectionFile(tmp_path / "file")


@pytest.mark.parametrize("missing", ["all", "picture", "end"])
def test_a_full_disk_costs_the_cache_and_nothing_else(tmp_path, cache, monkeypatch, missing):
    path = textured(tmp_path)
    target = write(path)
    sections_written = len(SectionFile(target))
    target.unlink()
    room = {"all": 0, "picture": sections_written - 1, "end": sections_written}[missing]
    real = SectionWriter.add
    written = []

    def full(*_):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    def add(self, array):
        written.append(array)
        return real(self, array) if len(written) <= room else full()

    monkeypatch.setattr(SectionWriter, "add", add)
    monkeypatch.setattr(paths.WholeFile, "keep", full)
    opened = open_scene(path)
    if missing == "all":
        assert opened.writer is None
        told = opened.scene.warnings[-1]
    else:
        told = opened.writer.finish()
        assert opened.writer.failed
    assert "No space left on device" in told and "next time" in told
    assert opened.scene.images[0].pixels.shape == (4, 4, 4)
    assert list(cache.iterdir()) == []


def test_a_cache_that_cannot_be_written_costs_nothing_else(tmp_path, monkeypatch):
    file = tmp_path / "no folder"
    file.write_text("")
    monkeypatch.setenv("STRATA_CACHE", str(file))
    path = textured(tmp_path)
    for _ in range(2):
        opened = open_scene(path)
        assert opened.writer is None and not opened.scene.warnings
        assert difference(load_scene(path), opened.scene) == ""


def test_a_damaged_picture_is_an_error_of_the_scene_and_not_of_the_cache(tmp_path, cache):
    path = textured(tmp_path)
    data = bytearray((tmp_path / "scene.bin").read_bytes())
    place = data.index(b"IDAT") + 6
    data[place : place + 8] = bytes(8)
    (tmp_path / "scene.bin").write_bytes(data)
    opened = open_scene(path)
    assert "is damaged" in opened.writer.finish() and not opened.writer.failed
    assert list(cache.iterdir()) == []


_OPEN = """
import sys
from pathlib import Path
from chapters.ch03.scene_cache.cache import open_scene
for _ in range(20):
    opened = open_scene(Path(sys.argv[1]))
    if opened.writer is not None:
        opened.writer.finish()
    elif int(sys.argv[2]):
        from chapters.ch03.scene_cache.cache import cache_file
        cache_file(Path(sys.argv[1])).unlink(missing_ok=True)
    assert all(image.pixels.sum() == 2016 for image in opened.scene.images)
    assert not opened.scene.warnings, opened.scene.warnings
"""


def test_processes_that_write_and_read_at_once_disturb_each_other_never(tmp_path, cache):
    path = textured(tmp_path)
    command = [sys.executable, "-c", _OPEN, str(path)]
    running = [
        subprocess.Popen([*command, str(number % 2)], cwd=ROOT, stderr=subprocess.PIPE) for number in range(2)
    ]
    for process in running:
        _, errors = process.communicate(timeout=60)
        assert process.returncode == 0, errors.decode()
    assert {file.name for file in cache.iterdir()} <= {cache_file(path).name}


def test_whatever_a_directory_says_is_a_miss_at_worst(tmp_path, monkeypatch):
    path = textured(tmp_path)
    target = write(path)
    about = SectionFile(target).about
    text = json.loads(about["scene"])
    for change in ({"vertices": []}, {"meshes": 999}, {"nodes": None}, {"materials": [[1]]}):
        writer = SectionWriter(target)
        writer.add(np.zeros(3, np.uint8))
        writer.keep(about | {"scene": json.dumps(text | change)})
        with pytest.raises(CacheMiss):
            read_cache(target, path)
