"""Meshlets of opened scenes: built once, in a thread while the rest loads, and the second time read from the cache."""

from __future__ import annotations

import gc
import threading
import weakref
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from chapters.ch06.meshlets import build
from chapters.ch06.meshlets import scene as kept_meshlets
from chapters.ch06.meshlets.build import build_meshlets
from chapters.ch06.meshlets.scene import begin_meshlets, keep_meshlets, meshlets_of
from chapters.ch06.scene_cache import cache as scene_cache
from chapters.ch06.scene_cache.cache import CacheMiss, cache_file, open_scene, read_cache
from chapters.ch06.scene_cache.sections import SectionFile, SectionWriter
from common.errors import SceneError
from common.gltf import load_scene
from common.paths import matched
from tests.common.gltf.builder import TRIANGLE, Gltf
from tests.support.meshes import grid, scene_of
from tests.support.meshlet_surfaces import sphere

generation = pytest.mark.feature("meshlets/generation")
FIELDS = ("records", "words", "ranges", "indices")


@pytest.fixture(autouse=True)
def cache(tmp_path, monkeypatch):
    """A cache of its own, empty."""
    monkeypatch.setenv("STRATA_CACHE", str(tmp_path / "cache"))


def written(folder, rows=12):
    """Write a scene of two meshes that are cut and one that is not, and a picture."""
    gltf = Gltf()
    gltf.add("textures", {"source": gltf.image(np.full((4, 4, 4), 200, np.uint8))})
    gltf.add("materials", {"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}})
    for positions, indices in (grid(9, rows), sphere(rows), (TRIANGLE, np.arange(3, dtype=np.uint32))):
        uv = positions[:, :2].copy()
        gltf.draw(gltf.primitive(indices, POSITION=positions, TEXCOORD_0=uv, material=0))
    return gltf.write(folder, "gltf")


def finished(path):
    """Open a scene, let its cache be written, and return the scene."""
    opened = open_scene(path)
    opened.writer.finish()
    assert opened.writer.told.startswith("It is cached"), opened.writer.told
    return opened.scene


def same(one, other):
    """Whether two sets of meshlets have the same bytes."""
    return all(getattr(one, name).tobytes() == getattr(other, name).tobytes() for name in FIELDS)


def refuse_to_build(monkeypatch):
    def fail(scene):
        raise AssertionError("the meshlets were built again")

    monkeypatch.setattr(kept_meshlets, "build_meshlets", fail)


@generation
def test_the_second_load_maps_the_meshlets(tmp_path, monkeypatch):
    path = written(tmp_path)
    first = meshlets_of(finished(path))
    assert (first.ranges[:, 1] > 0).tolist() == [True, True, False]
    assert same(first, build_meshlets(load_scene(path)))
    refuse_to_build(monkeypatch)
    opened = open_scene(path)
    assert opened.writer is None
    again = meshlets_of(opened.scene)
    assert same(first, again) and again.records.dtype == first.records.dtype
    for name in FIELDS:
        array = getattr(again, name)
        assert not array.flags.owndata and not array.flags.writeable
    assert (again.indices != opened.scene.indices).any()


@generation
def test_a_stale_cache_has_the_meshlets_of_no_scene(tmp_path, monkeypatch):
    path = written(tmp_path)
    first = meshlets_of(finished(path))
    written(tmp_path, rows=14)
    second = meshlets_of(finished(path))
    assert len(second.indices) > len(first.indices) and same(second, build_meshlets(load_scene(path)))
    monkeypatch.setattr(scene_cache, "maker", lambda: "another builder")
    with pytest.raises(CacheMiss, match="another version"):
        read_cache(cache_file(path), path)


def test_every_module_of_the_builder_decides_about_a_cache():
    names = {path.name for path in matched(scene_cache._PARTS, Path(scene_cache.__file__).parents[1])}
    assert {
        "build.py",
        "order.py",
        "groups.py",
        "bounds.py",
        "packing.py",
        "model.py",
        "meshlets.py",
    } <= names


@generation
def test_damaged_meshlets_are_built_again(tmp_path):
    path = written(tmp_path)
    first = meshlets_of(finished(path))
    target = cache_file(path)
    whole = target.read_bytes()
    stored = SectionFile(target).about["meshlets"]
    for name in FIELDS:
        place = SectionFile(target)._columns["place"][stored[name]]
        data = bytearray(whole)
        data[place] ^= 1
        target.write_bytes(data)
        with pytest.raises(CacheMiss, match="damaged section"):
            read_cache(target, path)
        opened = open_scene(path)
        assert same(meshlets_of(opened.scene), first)
        opened.writer.stop()
        target.write_bytes(whole)


@generation
@pytest.mark.parametrize("change", ["missing", "no number", "of another scene", "of another shape"])
def test_a_cache_without_its_meshlets_is_made_anew(tmp_path, monkeypatch, change):
    path = written(tmp_path)
    keep = SectionWriter.keep

    def spoiled(writer, about):
        stored = dict(about["meshlets"])
        if change == "missing":
            return keep(writer, {name: value for name, value in about.items() if name != "meshlets"})
        if change == "no number":
            stored["words"] = 9999
        elif change == "of another scene":
            stored["ranges"] = stored["indices"]
        else:
            stored["records"] = stored["words"]
        return keep(writer, about | {"meshlets": stored})

    monkeypatch.setattr(SectionWriter, "keep", spoiled)
    finished(path)
    monkeypatch.undo()
    monkeypatch.setenv("STRATA_CACHE", str(tmp_path / "cache"))
    with pytest.raises(CacheMiss, match="makes no sense"):
        read_cache(cache_file(path), path)
    assert same(meshlets_of(finished(path)), build_meshlets(load_scene(path)))
    assert open_scene(path).writer is None


@generation
def test_a_scene_without_meshlets_stores_none(tmp_path, monkeypatch):
    gltf = Gltf()
    gltf.draw(gltf.primitive(POSITION=TRIANGLE))
    path = gltf.write(tmp_path, "gltf")
    finished(path)
    assert SectionFile(cache_file(path)).about["meshlets"] is None
    scene = open_scene(path).scene
    assert not len(meshlets_of(scene).records) and (meshlets_of(scene).indices == scene.indices).all()


@generation
def test_a_scene_that_is_too_large_for_meshlets_is_cached_without(tmp_path, monkeypatch):
    path = written(tmp_path)
    monkeypatch.setattr(build, "MOST_INDICES", 100)
    with pytest.raises(SceneError, match="at most 100"):
        meshlets_of(finished(path))
    opened = open_scene(path)
    assert opened.writer is None
    with pytest.raises(SceneError, match="split the scene"):
        meshlets_of(opened.scene)


def test_they_are_built_in_a_thread_and_waited_for(monkeypatch):
    scene = scene_of(sphere(12))
    threads, go = [], threading.Event()

    def slow(scene):
        threads.append(threading.current_thread().name)
        assert go.wait(10)
        return build_meshlets(scene)

    monkeypatch.setattr(kept_meshlets, "build_meshlets", slow)
    begin_meshlets(scene)
    while not threads:
        pass
    asked = threading.Thread(target=lambda: threads.append(meshlets_of(scene)))
    asked.start()
    asked.join(0.02)
    assert asked.is_alive(), "it did not wait"
    go.set()
    asked.join()
    assert threads[0] == "meshlets" and threads[1] is meshlets_of(scene) and len(threads) == 2


def test_one_scene_is_built_once_and_its_views_are_others(monkeypatch):
    scene = scene_of(sphere(12))
    meshlets = meshlets_of(scene)
    assert meshlets_of(scene) is meshlets
    assert meshlets_of(replace(scene)) is not meshlets
    small = build_meshlets(scene, 32, 32)
    keep_meshlets(scene, small)
    assert meshlets_of(scene) is small


def test_meshlets_go_with_their_scene():
    scene = scene_of(sphere(12))
    kept = weakref.ref(meshlets_of(scene))
    number = id(scene)
    assert number in kept_meshlets._MESHLETS._entries and kept() is not None
    del scene
    gc.collect()
    assert number not in kept_meshlets._MESHLETS._entries and kept() is None


def test_an_error_in_the_thread_reaches_the_one_who_asks(monkeypatch):
    monkeypatch.setattr(build, "MOST_INDICES", 100)
    scene = scene_of(sphere(12))
    begin_meshlets(scene)
    for _ in range(2):
        with pytest.raises(SceneError, match="at most 100"):
            meshlets_of(scene)
