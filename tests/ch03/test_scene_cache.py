"""The scene cache: what is written is what is read, bit for bit, and it is read from one mapped file."""

from __future__ import annotations

import sys
import threading

import numpy as np
import pytest

from assets import locate
from chapters.ch03.scene.material_types import TYPES
from chapters.ch03.scene_cache import cache as scene_cache
from chapters.ch03.scene_cache.cache import cache_file, open_scene, read_cache, sorted_types
from chapters.ch03.scene_cache.sections import SectionFile
from common.gltf import load_scene
from common.paths import asset_dir
from common.scene import Animation
from tests.common.gltf.builder import QUAD, QUAD_INDICES, Gltf
from tests.support.scene_equality import difference

file_row = pytest.mark.feature("scene-cache/file")
LARGE = ("FlightHelmet", "ToyCar", "Suzanne", "LightsPunctualLamp", "AlphaBlendModeTest", "NormalTangentTest")
"""Models that take longer than 0.3 s."""


@pytest.fixture(autouse=True)
def cache(tmp_path, monkeypatch):
    """A cache of its own, empty."""
    monkeypatch.setenv("STRATA_CACHE", str(tmp_path / "cache"))
    return tmp_path / "cache"


def rich(folder, offset=0.0, form="gltf"):
    """Write a scene with what models made elsewhere rarely have together."""
    gltf = Gltf()
    rng = np.random.default_rng(3)
    smooth = np.linspace(0, 255, 64 * 64 * 4).reshape(64, 64, 4).astype(np.uint8)
    pictures = [
        smooth,
        rng.integers(0, 255, (20, 12, 3), np.uint8),
        rng.integers(0, 60000, (8, 8), np.uint16),
    ]
    for number, pixels in enumerate(pictures):
        gltf.add("textures", {"source": gltf.image(pixels, name=f"Bild {number} \u2603")})
    gltf.add(
        "materials",
        {
            "name": "Gr\u00fcn",
            "alphaMode": "MASK",
            "pbrMetallicRoughness": {
                "baseColorTexture": {"index": 0},
                "metallicRoughnessTexture": {"index": 1},
                "roughnessFactor": 0.1,
            },
            "occlusionTexture": {"index": 2},
            "emissiveFactor": [0.1, 0.2, 0.3],
        },
    )
    uv = np.array([(0, 1), (1, 1), (1, 0), (0, 0)], "f4")
    normals = np.tile(np.array([0, 0, 1], "f4"), (4, 1))
    target = {"POSITION": np.full((4, 3), 0.125, "f4")}
    quad = gltf.primitive(QUAD_INDICES, [target], POSITION=QUAD, NORMAL=normals, TEXCOORD_0=uv, material=0)
    node = gltf.draw(quad, name="n\u00f6de", translation=[offset, 0, 0], extras={"kept": [1, {"deep": None}]})
    gltf.json["meshes"][0]["weights"] = [0.25]
    times = gltf.accessor(np.array([0, 1], "f4"), min=[0.0], max=[1.0])
    gltf.add(
        "animations",
        {
            "name": "sway",
            "samplers": [{"input": times, "output": gltf.accessor(np.array([0.0, 1.0], "f4").reshape(2, 1))}],
            "channels": [{"sampler": 0, "target": {"node": node, "path": "weights"}}],
        },
    )
    return gltf.write(folder, form)


def cached(path, compressed=False):
    """Cache the scene of a file and return it as it comes from there."""
    opened = open_scene(path, compressed=compressed)
    opened.writer.finish()
    assert opened.writer.told.startswith("It is cached"), opened.writer.told
    return read_cache(cache_file(path, compressed), path, compressed)


@file_row
def test_a_scene_comes_back_bit_for_bit(tmp_path):
    path = rich(tmp_path)
    scene = cached(path)
    assert difference(load_scene(path), scene) == ""
    # That the comparison has something to compare: none of these may be empty.
    assert scene.nodes.extras and scene.deformations and scene.animations and len(scene.images) == 3
    assert isinstance(scene.animations[0], Animation) and scene.images[2].dtype == np.uint16


@file_row
@pytest.mark.parametrize("name", ["atrium", "cornell", "spheres"])
def test_our_own_scenes_come_back_bit_for_bit(name):
    assert difference(load_scene(locate(name)), cached(locate(name))) == ""


def models_here():
    """Return the names of the models, for which tests are named before any runs."""
    folder = asset_dir()
    return sorted(path.name for path in (folder / "models").iterdir() if path.is_dir()) if folder else []


@file_row
@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=pytest.mark.long if name in LARGE else ()) for name in models_here()]
)
def test_models_made_elsewhere_come_back_bit_for_bit(models, name):
    path = next(path for path in sorted((models / name).rglob("*")) if path.suffix in (".gltf", ".glb"))
    assert difference(load_scene(path), cached(path)) == ""


@file_row
def test_offsets_are_monotone_and_end_at_the_totals():
    path = locate("atrium")
    scene = cached(path)
    types = SectionFile(cache_file(path)).about["types"]
    totals = {
        "material_offsets": len(scene.materials),
        "mesh_offsets": len(scene.meshes),
        "index_offsets": int(scene.meshes["index_count"].sum()),
    }
    for name, total in totals.items():
        assert len(types[name]) == len(TYPES) + 1
        assert types[name][0] == 0 and (np.diff(types[name]) >= 0).all() and types[name][-1] == total
    assert sorted(types["meshes"]) == list(range(len(scene.meshes)))
    assert all((types[name] == made).all() for name, made in sorted_types(scene).items())


@file_row
def test_arrays_lie_in_the_mapped_file_at_multiples_of_64_bytes(tmp_path):
    path = rich(tmp_path)
    scene = cached(path)
    for array in (
        scene.positions,
        scene.indices,
        scene.images[0].pixels,
        scene.animations[0].channels[0].values,
    ):
        assert not array.flags.owndata and not array.flags.writeable
        assert array.ctypes.data % 64 == 0


def test_an_edit_changes_the_scene_and_not_the_cache(tmp_path):
    path = rich(tmp_path)
    first = cached(path)
    with first.edit() as edit:
        edit.set_transform(0, translation=(1.0, 2.0, 3.0))
        edit.set_visible(0, False)
    again = read_cache(cache_file(path), path)
    assert again.nodes.translation[0].tolist() == [0.0, 0.0, 0.0] and again.instances.visible.all()


def test_far_from_the_origin_nothing_is_rounded(tmp_path):
    path = rich(tmp_path, 1e5 + 0.1)
    scene = cached(path)
    assert difference(load_scene(path), scene) == ""
    assert scene.nodes.translation[0, 0] == 1e5 + 0.1
    assert scene.origin[0] > 1e5


def test_names_of_files_may_be_in_any_script(tmp_path):
    folder = tmp_path / "S\u0151l\u00e9t \u2603 100%"
    folder.mkdir()
    path = rich(folder)
    assert difference(load_scene(path), cached(path)) == ""


def test_nothing_is_parsed_for_a_vertex_a_node_or_a_texel(tmp_path):
    """A scene with twenty times as many takes no more calls of Python."""

    def calls(count):
        gltf = Gltf()
        positions = np.repeat(QUAD, count, axis=0)
        gltf.draw(gltf.primitive(POSITION=positions[: len(positions) // 3 * 3]))
        for number in range(count):
            gltf.node(name=f"{number}")
        path = gltf.write(tmp_path)
        cached(path)
        found = [0]

        def count_call(_frame, event, _argument):
            found[0] += event == "call"

        sys.setprofile(count_call)
        try:
            read_cache(cache_file(path), path)
        finally:
            sys.setprofile(None)
        return found[0]

    calls(10)
    assert calls(2000) <= calls(100) * 1.2


def test_pictures_are_cached_by_those_who_decode_them(tmp_path, no_thread_left):
    path = rich(tmp_path)
    opened = open_scene(path)
    for image in opened.scene.images:
        assert opened.writer.told == ""
        image.decode()
    opened.writer.stop()  # which waits for what is whole
    assert cache_file(path).is_file() and opened.writer.told.startswith("It is cached")


def test_progress_tells_the_part_of_the_images_that_is_cached(tmp_path):
    opened = open_scene(rich(tmp_path))
    told = []
    opened.writer.finish(lambda part, what: told.append((part, what)))
    parts, words = zip(*told, strict=True)
    thirds = [1 / 3, 2 / 3, 1.0]  # of its three images; threads may tell of one together
    assert all(min(abs(part - one) for one in thirds) < 1e-6 for part in parts)
    assert len(parts) == 3 and max(parts) == 1.0 and set(words) == {"caching images"}


def test_progress_counts_images_that_other_threads_still_write(tmp_path, monkeypatch):
    opened = open_scene(rich(tmp_path))
    others = [threading.Thread(target=image.decode) for image in opened.scene.images[:2]]
    add, both_write, told = opened.writer._file.add, threading.Barrier(3), []
    one_is_cached = threading.Event()

    def waits(pixels):
        if threading.current_thread() in others:
            both_write.wait(10.0)
            assert one_is_cached.wait(10.0)
        return add(pixels)

    monkeypatch.setattr(opened.writer._file, "add", waits)
    for thread in others:
        thread.start()
    both_write.wait(10.0)
    opened.writer.finish(lambda part, _: (told.append(part), one_is_cached.set()))
    assert told == [pytest.approx(1 / 3)] and opened.writer.told.startswith("It is cached")
    for thread in others:
        thread.join()


def test_closing_early_leaves_no_file(tmp_path, cache):
    opened = open_scene(rich(tmp_path))
    opened.scene.images[0].decode()
    opened.writer.stop()
    opened.scene.images[1].decode()
    assert not list((cache / scene_cache.FOLDER).iterdir())
    assert not opened.writer.failed and "not cached" in opened.writer.told


def test_the_second_opening_says_that_it_comes_from_the_cache(tmp_path):
    path = rich(tmp_path)
    first = open_scene(path)
    assert "it had no cache" in first.told
    first.writer.finish()
    second = open_scene(path)
    assert second.writer is None and "from its cache" in second.told
    assert "without a cache" in open_scene(path, cached=False).told
