"""Compressed scene caches: a chain of blocks for each way in which a picture is read, and what is not compressed."""

from __future__ import annotations

import json

import numpy as np
import pytest

from chapters.ch03.scene_cache import cache as scene_cache
from chapters.ch03.scene_cache.cache import cache_file, open_scene, read_cache
from chapters.ch03.scene_cache.images import image_uses
from chapters.ch03.scene_cache.sections import SectionFile
from common.errors import UnsupportedError
from common.gltf import load_scene
from common.images import blocks
from common.images.mips import mip_chain
from tests.common.gltf.builder import QUAD, QUAD_INDICES, Gltf
from tests.support.block_pictures import decoded, pictures
from tests.support.scene_equality import difference

pytestmark = pytest.mark.needs("etcpak")
file_row = pytest.mark.feature("scene-cache/file")
SIDE = 200
"""Texels: above the least that is compressed, and no power of two."""


def psnr(one, other):
    """Return the peak signal-to-noise ratio of two pictures of bytes, dB."""
    return -10.0 * np.log10(np.square(one / 255.0 - other / 255.0).mean() + 1e-12)


@pytest.fixture(autouse=True)
def cache(tmp_path, monkeypatch):
    """A cache of its own, empty."""
    monkeypatch.setenv("STRATA_CACHE", str(tmp_path / "cache"))
    return tmp_path / "cache" / scene_cache.FOLDER


@pytest.fixture
def path(tmp_path):
    """A scene with pictures of each use: colour, normals, surface, occlusion; a small one, one of 16 bits."""
    gltf = Gltf()
    made = pictures(SIDE, SIDE)
    deep = np.linspace(0, 65535, SIDE * SIDE).reshape(SIDE, SIDE).astype(np.uint16)
    for pixels in (
        made["smooth"],
        made["normal"],
        made["smooth"][::-1].copy(),  # pictures of equal bytes would be one image of the scene
        made["smooth"][..., :3],
        made["noise"][:8, :8],
        deep,
    ):
        gltf.add("textures", {"source": gltf.image(pixels)})
    gltf.add(
        "materials",
        {
            "pbrMetallicRoughness": {
                "baseColorTexture": {"index": 0},
                "metallicRoughnessTexture": {"index": 2},
            },
            "normalTexture": {"index": 1},
            "occlusionTexture": {"index": 3},
            "emissiveTexture": {"index": 4},
        },
    )
    gltf.add("materials", {"pbrMetallicRoughness": {"baseColorTexture": {"index": 5}}})
    uv = np.array([(0, 1), (1, 1), (1, 0), (0, 0)], "f4")
    normals = np.tile(np.array([0, 0, 1], "f4"), (4, 1))
    for material in range(2):
        gltf.draw(
            gltf.primitive(QUAD_INDICES, POSITION=QUAD, NORMAL=normals, TEXCOORD_0=uv, material=material)
        )
    return gltf.write(tmp_path)


def cached(path):
    """Return the scene from its compressed cache, after making that."""
    opened = open_scene(path, compressed=True)
    opened.writer.finish()
    assert opened.writer.told.startswith("It is cached"), opened.writer.told
    return read_cache(cache_file(path, True), path, compressed=True)


EXPECTED = {0: ("bc7_srgb", "rgba"), 1: ("bc7", "rgba"), 2: ("bc5", "0rg1"), 3: ("bc4", "r001")}
PSNR_DB = {"bc7_srgb": 38.0, "bc7": 38.0, "bc5": 42.0, "bc4": 42.0}


@file_row
@pytest.mark.needs("texture2ddecoder")
def test_each_use_has_a_chain_that_is_close_to_the_picture(path):
    scene, source = cached(path), load_scene(path)
    for number, uses in image_uses(source).items():
        for srgb, mipmapped, channels in uses:
            chain = scene.images[number].chain(srgb, mipmapped, channels)
            if number not in EXPECTED:
                assert chain is None
                continue
            assert chain is not None and (chain.format, chain.swizzle) == EXPECTED[number]
            assert len(chain.levels) == SIDE.bit_length()
            columns = {"r": [0], "gb": [1, 2]}.get(channels, [0, 1, 2, 3])
            levels = mip_chain(source.images[number].pixels, srgb)
            for level, truth in zip(chain.levels, levels, strict=True):
                height, width = truth.shape[:2]
                found = decoded(level, chain.format, width, height)[..., : len(columns)]
                if min(width, height) >= 100:  # what is smaller is steeper than blocks can be
                    assert psnr(found, truth[..., columns]) > PSNR_DB[chain.format]
                assert not level.flags.writeable


@file_row
def test_what_is_small_or_has_sixteen_bits_is_kept_as_it_is(path):
    scene, source = cached(path), load_scene(path)
    for number in (4, 5):
        assert scene.images[number]._record["pixels"] is not None
        assert difference(source.images[number], scene.images[number]) == ""


def test_pixels_that_are_not_in_the_cache_come_from_the_source(path):
    scene, source = cached(path), load_scene(path)
    assert scene.images[0].chain(False, True, "rgba") is None  # as data it is not read
    assert difference(source.images, scene.images) == ""


def test_a_compressed_cache_is_another_file_and_a_smaller_one(path):
    cached(path)
    plain = open_scene(path)
    assert "it had no cache" in plain.told
    plain.writer.finish()
    assert cache_file(path, True).stat().st_size < cache_file(path).stat().st_size


@pytest.mark.feature("scene-cache/validity")
def test_a_damaged_chain_is_removed_and_its_picture_read_from_the_source(path):
    cached(path)
    target = cache_file(path, True)
    file = SectionFile(target)
    section = json.loads(file.about["images"])[0]["chains"][0][4]
    data = bytearray(target.read_bytes())
    data[file._columns["place"][section] + 5] ^= 1
    target.write_bytes(data)
    scene = read_cache(target, path, compressed=True)
    before = len(scene.warnings)
    for _ in range(2):
        assert scene.images[0].chain(True, True, "rgba") is None
    assert scene.images[1].chain(False, True, "rgba") is not None
    assert difference(load_scene(path).images[0], scene.images[0]) == ""
    assert len(scene.warnings) == before + 1 and not target.exists()


def test_without_an_encoder_a_compressed_cache_can_be_read_and_not_made(path, monkeypatch):
    cached(path)
    monkeypatch.setattr(blocks, "lack", lambda: "is not installed")
    assert open_scene(path, compressed=True).writer is None
    cache_file(path, True).unlink()
    with pytest.raises(UnsupportedError, match="etcpak"):
        open_scene(path, compressed=True)


def test_compression_beside_a_window_ends_with_it(path, cache, no_thread_left):
    opened = open_scene(path, compressed=True)
    opened.writer.start()
    opened.scene.images[0].decode()
    opened.writer.stop()
    assert opened.writer.told.startswith("It is cached") == cache_file(path, True).exists()
    assert len(list(cache.iterdir())) == cache_file(path, True).exists()


def test_compression_beside_a_window_can_be_waited_for(path, no_thread_left):
    opened = open_scene(path, compressed=True)
    opened.writer.start()
    assert opened.writer.finish().startswith("It is cached")
    opened.writer.stop()
    assert read_cache(cache_file(path, True), path, compressed=True).images[0].chain(True, True, "rgba")


@pytest.mark.parametrize(
    "error", [RuntimeError("a mistake"), UnsupportedError("Block compression needs a package.")]
)
def test_an_encoder_that_fails_leaves_nothing_that_waits_for_ever(
    path, cache, no_thread_left, error, monkeypatch
):
    """Every image is begun and none is ended: a second wait has nothing to do but to see that."""

    def fail(*_):
        raise error

    opened = open_scene(path, compressed=True)
    monkeypatch.setattr(scene_cache, "compress", fail)
    if isinstance(error, UnsupportedError):
        opened.writer.finish()
    else:
        with pytest.raises(RuntimeError, match="a mistake"):
            opened.writer.finish()
    assert str(error) in opened.writer.finish() and opened.writer.failed
    assert list(cache.iterdir()) == []
