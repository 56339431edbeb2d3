"""Scenes by name: every one loads, a wrong name suggests the near one, and other sizes are made once and kept."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from assets import SCENES, locate, scenes
from assets.__main__ import main
from assets.scenes import make
from common.errors import UserError
from common.gltf import load_scene
from common.paths import ROOT
from common.scene import Scene
from tests.assets.conftest import SIZES

NEAR = {"large": 250_000, "medium": 30_000}
"""About how many triangles the sizes of the atrium are meant to have."""


@pytest.fixture
def cache(tmp_path, monkeypatch):
    """A cache of one test's own, and a note of every scene that is made; a few boxes stand in for all of them."""
    made: list[str] = []

    def few_boxes(info, size):
        made.append(size)
        builder = make(SCENES["cornell"], "medium")
        builder.name = info.name
        return builder

    monkeypatch.setenv("STRATA_CACHE", str(tmp_path / "cache"))
    monkeypatch.setattr(scenes, "make", few_boxes)
    scenes._temporary.cache_clear()
    yield tmp_path / "cache", made
    scenes._temporary.cache_clear()


def finite(scene: Scene) -> bool:
    arrays = [scene.positions, scene.normals, scene.tangents, scene.uv0, scene.bounds]
    arrays += [array for array in (scene.uv1, scene.colors) if array is not None]
    return all(np.isfinite(array).all() for array in arrays)


# --- names ---


@pytest.mark.parametrize(("name", "size"), SIZES)
def test_every_scene_loads_by_name_without_a_warning(name, size, kept, monkeypatch):
    monkeypatch.setenv("STRATA_CACHE", str(kept))
    scene = load_scene(locate(f"{name}:{size}"))
    assert scene.warnings == []
    assert finite(scene)
    assert np.allclose(np.linalg.norm(scene.normals, axis=1), 1, atol=1e-5)
    drawn = int(scene.meshes["index_count"][scene.instances.mesh].sum()) // 3
    assert drawn == SCENES[name].sizes[size], "SceneInfo.sizes says how many triangles are drawn"
    assert scene.cameras and scene.lights, "something to see, and light to see it by"
    assert all(camera.name and camera.ev100 is not None for camera in scene.cameras)


def test_the_sizes_are_what_they_are_meant_to_be():
    atrium = SCENES["atrium"]
    assert atrium.default_size == "medium" and atrium.triangles == atrium.sizes["medium"]
    for size, meant in NEAR.items():
        assert abs(atrium.sizes[size] - meant) <= 0.2 * meant
    assert atrium.sizes["small"] <= 0.4 * atrium.sizes["medium"]


@pytest.mark.parametrize("name", [name for name, info in SCENES.items() if info.in_clone])
def test_the_default_size_lies_in_the_clone(name, tmp_path, monkeypatch):
    monkeypatch.setenv("STRATA_CACHE", str(tmp_path / "cache"))
    assert locate(name) == locate(f"{name}:medium") == SCENES[name].committed()
    assert not (tmp_path / "cache").exists(), "nothing is made or written"


@pytest.mark.parametrize(
    ("wrong", "says"),
    [
        ("atrum", 'did you mean "atrium"?'),
        ("sphere", 'did you mean "spheres"?'),
        ("xyzzy", "choose one of atrium, city, cloth, cornell, market, spheres."),
        ("atrium:larg", 'did you mean "atrium:large"?'),
        ("atrium:", "choose one of medium, small, large, fog."),
        ("cornell:zzz", "choose one of medium."),
    ],
)
def test_a_wrong_name_suggests_the_near_one(wrong, says):
    with pytest.raises(UserError) as caught:
        locate(wrong)
    assert str(caught.value).endswith(says)


@pytest.mark.parametrize("name", ["atrium:small", "cornell", "spheres"])
def test_both_kinds_of_file_hold_the_same_scene(name, tmp_path):
    builder = make(*scenes.find(name))
    one, two = (load_scene(builder.save(tmp_path / str(binary), binary)) for binary in (False, True))
    assert (one.path.suffix, two.path.suffix) == (".gltf", ".glb")
    for field in ("positions", "normals", "tangents", "uv0", "uv1", "colors", "indices", "meshes"):
        a, b = getattr(one, field), getattr(two, field)
        assert (a is None) == (b is None) and (a is None or np.array_equal(a, b)), field
    for field in ("mesh_names", "materials", "lights", "cameras", "ambient"):
        assert getattr(one, field) == getattr(two, field), field
    for a, b in zip(one.images, two.images, strict=True):
        assert a.name == b.name and np.array_equal(a.pixels, b.pixels)
    assert one.nodes.names == two.nodes.names and one.nodes.extras == two.nodes.extras
    assert np.array_equal(one.instances.node, two.instances.node)
    for a, b in zip(one.animations, two.animations, strict=True):
        assert a.name == b.name and a.duration == b.duration and len(a.channels) == len(b.channels)


# --- the cache ---


def test_another_size_is_made_once(cache):
    folder, made = cache
    first, again = locate("atrium:small"), locate("atrium:small")
    assert first == again and first.is_relative_to(folder)
    assert made == ["small"]
    assert [path for path in folder.rglob("*") if path.is_file()] == [first], (
        "nothing half-written lies about"
    )


def test_another_generator_makes_another_file(cache, monkeypatch):
    monkeypatch.setattr(scenes, "write", lambda name, folder, size, binary: folder)
    monkeypatch.setattr(scenes, "generator_version", lambda: "one")
    first = locate("atrium:small")
    monkeypatch.setattr(scenes, "generator_version", lambda: "two")
    assert locate("atrium:small") != first


def test_a_scene_that_could_not_be_written_is_made_for_this_process(cache, monkeypatch):
    folder, _ = cache

    def full(source, target):
        if Path(target).is_relative_to(folder):
            raise OSError(28, "No space left on device")
        rename(source, target)

    rename = os.replace
    monkeypatch.setattr(os, "replace", full)
    path = locate("atrium:small")
    assert path.is_file() and not path.is_relative_to(folder)
    assert not [path for path in folder.rglob("*") if path.is_file()], "no part of it stays in the cache"
    assert locate("atrium:small") == path


def test_without_a_cache_a_scene_lives_until_the_process_ends(cache, tmp_path, monkeypatch):
    _, made = cache
    (tmp_path / "file").touch()
    monkeypatch.setenv("STRATA_CACHE", str(tmp_path / "file" / "below"))
    path = locate("atrium:small")
    assert path == locate("atrium:small") and path.is_file()
    assert made == ["small"]
    assert (tmp_path / "file").is_file()


def test_what_a_read_only_cache_holds_is_used(cache, monkeypatch):
    _, made = cache
    path = locate("atrium:small")
    monkeypatch.setattr(
        scenes, "cache_dir", lambda name: None
    )  # root may write anywhere, so modes show nothing
    assert locate("atrium:small") == path
    assert made == ["small"]


def test_two_processes_at_once_get_a_whole_scene(tmp_path):
    code = """
import sys
from assets import locate
from common.gltf import load_scene
sys.stdin.readline()
path = locate("atrium:small")
print(path, load_scene(path).triangle_count)
"""
    environment = {**os.environ, "STRATA_CACHE": str(tmp_path)}
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "text": True}
    both = [
        subprocess.Popen([sys.executable, "-c", code], cwd=ROOT, env=environment, **pipes) for _ in range(2)
    ]
    for process in both:
        process.stdin.write("go\n")
        process.stdin.flush()
    said = [process.communicate(timeout=60)[0] for process in both]
    assert [process.returncode for process in both] == [0, 0]
    assert said[0] == said[1] != ""
    assert len([path for path in tmp_path.rglob("*") if path.is_file()]) == 1


# --- python -m assets ---


def test_the_module_lists_the_scenes():
    done = subprocess.run(
        [sys.executable, "-m", "assets", "list"], cwd=ROOT, capture_output=True, text=True, check=True
    )
    for info in SCENES.values():
        assert info.name in done.stdout and info.exercises in done.stdout
        assert f"{info.triangles:,}" in done.stdout
    assert done.stderr == ""


@pytest.mark.parametrize("suffix", ["gltf", "glb"])
def test_the_module_writes_a_scene(suffix, tmp_path, capsys):
    options = ["--glb"] if suffix == "glb" else []
    assert main(["write", "cornell", str(tmp_path / "new"), *options]) == 0
    path = tmp_path / "new" / f"cornell.{suffix}"
    assert str(path) in capsys.readouterr().out
    assert load_scene(path).triangle_count == load_scene(locate("cornell")).triangle_count


@pytest.mark.parametrize("arguments", [["write", "atrum", "here"], ["write", "cornell", "file"]])
def test_the_module_says_what_is_wrong_in_one_sentence(arguments, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    Path("file").touch()
    assert main(arguments) == 2
    said = capsys.readouterr()
    assert said.out == "" and said.err.count("\n") == 1
    assert sorted(os.listdir()) == ["file"], "nothing is written"


def test_remake_would_write_where_the_committed_files_are(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(scenes, "COMMITTED", tmp_path)
    monkeypatch.setattr("assets.__main__.SCENES", {"cornell": SCENES["cornell"]})
    stale = tmp_path / "cornell" / "old.png"
    stale.parent.mkdir()
    stale.touch()
    assert main(["remake"]) == 0
    assert {path.name for path in stale.parent.iterdir()} == {"cornell.gltf", "cornell.bin"}
    assert "cornell" in capsys.readouterr().out


def test_a_scene_in_fog_says_its_medium():
    """The rest of the scene is that without, but for its ambient light and one more camera."""
    clear, foggy = (load_scene(locate(name)) for name in ("atrium", "atrium:fog"))
    assert clear.medium is None and foggy.medium is not None
    assert 0.01 < foggy.medium.extinction < 0.1 and max(foggy.medium.albedo) <= 1.0
    assert np.array_equal(clear.positions, foggy.positions) and foggy.triangle_count == clear.triangle_count
    assert [camera.name for camera in foggy.cameras] == ["shafts", *(camera.name for camera in clear.cameras)]
