"""The cache of a scene hashes the files that loading opened, and opens no other file, whatever the scene names."""

from __future__ import annotations

import json
import os
import subprocess
import sys

import numpy as np
import pytest

from chapters.ch03.scene_cache import cache as scene_cache
from chapters.ch03.scene_cache import sources
from chapters.ch03.scene_cache.cache import CacheMiss, cache_file, open_scene, read_cache
from chapters.ch03.scene_cache.sections import SectionFile
from common.paths import ROOT, matched
from tests.common.gltf.builder import TRIANGLE, Gltf, triangle

pytestmark = pytest.mark.feature("scene-cache/validity")


@pytest.fixture(autouse=True)
def cache(tmp_path, monkeypatch):
    """A cache of its own, empty, and not in the folder of the scene."""
    monkeypatch.setenv("STRATA_CACHE", str(tmp_path / "cache"))
    return tmp_path / "cache" / scene_cache.FOLDER


def textured(folder, uri):
    """Write a triangle with a picture of that name and of a second name that nothing uses; return the scene."""
    gltf = Gltf()
    gltf.add("images", {"uri": uri})
    gltf.add("images", {"uri": "unused.png"})
    gltf.add("buffers", {"byteLength": 84})
    gltf.add("buffers", {"byteLength": 1, "uri": "unused.bin"})
    gltf.add("textures", {"source": 0})
    gltf.add("materials", {"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}})
    uv = np.array([(0, 0), (1, 0), (0, 1)], "f4")
    gltf.draw(gltf.primitive(POSITION=TRIANGLE, TEXCOORD_0=uv, material=0))
    gltf.json["buffers"][0]["byteLength"] = len(gltf.data)
    return gltf.write(folder, "gltf")


def picture():
    """Return the bytes of a PNG."""
    gltf = Gltf()
    gltf.image(np.full((4, 4, 4), 200, np.uint8))
    return bytes(gltf.data)


def test_every_module_of_the_loader_decides_about_a_cache():
    """Also those in folders: a cache of an older loader must not be read."""
    loader = set((ROOT / "common" / "gltf").rglob("*.py"))
    assert len(loader) > 15
    assert loader <= {*matched(scene_cache._MAKERS)}


def test_the_names_of_a_record_are_those_that_the_loader_opened(tmp_path):
    path = textured(tmp_path, "a%20b.png")
    (tmp_path / "a b.png").write_bytes(picture())
    for name in ("unused.png", "unused.bin"):
        (tmp_path / name).write_bytes(b"nothing reads this")
    open_scene(path).writer.finish()
    kept = json.loads(SectionFile(cache_file(path)).about["sources"])
    assert sorted(kept["names"]) == ["a b.png", "a%20b.png", "scene.bin", "scene.gltf"]
    digests = dict(zip(kept["names"], kept["digests"], strict=True))
    assert digests["a%20b.png"] == "" and len(digests["a b.png"]) == 64
    (tmp_path / "unused.png").write_bytes(b"another content")
    assert open_scene(path).writer is None, "a file that nothing reads made a good cache worthless"
    (tmp_path / "a b.png").write_bytes(picture() + b"\0")
    with pytest.raises(CacheMiss, match="changed"):
        read_cache(cache_file(path), path)


_OPEN = """
import os, sys
from pathlib import Path
from chapters.ch03.scene_cache.cache import open_scene
path = Path(sys.argv[1])
folder = os.path.realpath(path.parent)
seen = []
sys.addaudithook(lambda event, args: seen.append(args[0]) if event == "open" else None)
for opening in range(2):
    opened = open_scene(path)
    if opened.writer is not None:
        print(opened.writer.finish())
allowed = (folder, os.environ["STRATA_CACHE"], sys.prefix, sys.base_prefix, sys.argv[2])
named = [os.path.realpath(os.fsdecode(one)) for one in seen if isinstance(one, (str, bytes, os.PathLike))]
print("OUTSIDE", [one for one in named if not one.startswith(allowed)])
print("INSIDE", sorted({os.path.basename(one) for one in named if os.path.dirname(one) == folder}))
"""


@pytest.mark.parametrize(
    "uri", ["/dev/zero", "..%2f..%2fdev%2fzero", "/etc/hostname", "pipe.png", "link.png", "folder", "\ud800"]
)
def test_an_image_that_nothing_uses_is_not_opened(tmp_path, uri):
    folder = tmp_path / "a" / "b"
    folder.mkdir(parents=True)
    (tmp_path / "outside").write_bytes(b"not ours")
    (folder / "folder").mkdir()
    if os.name != "nt":
        os.mkfifo(folder / "pipe.png")
        (folder / "link.png").symlink_to(tmp_path / "outside")
    gltf = triangle()
    gltf.json["images"] = [{"uri": uri}]
    path = gltf.write(folder, "gltf")
    done = subprocess.run(
        [sys.executable, "-P", "-c", _OPEN, str(path), str(ROOT)],
        cwd=ROOT,
        env=os.environ | {"PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        timeout=60,
    )
    assert done.returncode == 0, done.stderr
    assert "It is cached" in done.stdout
    assert "OUTSIDE []" in done.stdout and "INSIDE ['scene.bin', 'scene.gltf']" in done.stdout, done.stdout


@pytest.mark.skipif(os.name == "nt", reason="Windows names no pipe by a path, and links need a privilege")
@pytest.mark.parametrize("put", ["a pipe", "a link that leads outside"])
def test_a_source_that_became_something_else_is_not_read(tmp_path, monkeypatch, put):
    folder = tmp_path / "scene"
    folder.mkdir()
    path = textured(folder, "p.png")
    (folder / "p.png").write_bytes(picture())
    open_scene(path).writer.finish()
    read_cache(cache_file(path), path)
    (folder / "p.png").unlink()
    if put == "a pipe":
        os.mkfifo(folder / "p.png")
    else:
        (tmp_path / "p.png").write_bytes(picture())
        (folder / "p.png").symlink_to(tmp_path / "p.png")
    asked = []
    real = sources.digest
    monkeypatch.setattr(sources, "digest", lambda file: asked.append(file.name) or real(file))
    with pytest.raises(CacheMiss, match="changed"):
        read_cache(cache_file(path), path)
    assert "p.png" not in asked
