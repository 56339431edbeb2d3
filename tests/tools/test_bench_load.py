"""What the bench calls loading: which parts of a load it takes out, and that its warm-up leaves the rest cold."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from chapters import bench_load, bench_scene
from chapters.ch03.graphics.pipelines import Pipelines
from chapters.ch03.logic import scene_cache
from common import blocks
from common.errors import UnsupportedError
from common.scene_images import Image

SIZE = (16, 16)


@pytest.fixture
def squares(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A document of two textures that are large enough for blocks, and caches that nobody else uses."""
    monkeypatch.setenv("STRATA_CACHE", str(tmp_path / "cache"))
    folder = tmp_path / "scene"
    folder.mkdir()
    return bench_scene.write(folder, 2, 64)


def load(path: Path, way: str) -> dict[str, float]:
    try:
        return bench_load.once(3, "vulkan", path, SIZE, way)
    except UnsupportedError as error:
        pytest.skip(f"no Vulkan, or none that samples blocks: {error}")


def caches(path: Path) -> list[Path]:
    return [
        one
        for one in (scene_cache.cache_file(path, compressed) for compressed in (False, True))
        if one.exists()
    ]


@pytest.mark.feature("tools/bench")
def test_a_load_is_all_but_pipelines_and_what_any_scene_takes(squares):
    get = Pipelines.get
    plain = load(squares, "plain")
    assert Pipelines.get is get and caches(squares) == []
    assert plain["pipelines_s"] > 0 and plain["renderer_s"] > 0
    parts = plain["load_s"] + plain["pipelines_s"] + plain["renderer_s"]
    assert parts == pytest.approx(plain["total_s"])
    assert plain["load_s"] >= plain["scene_s"] > 0


def test_the_time_of_pipelines_is_that_of_the_calls_that_build_them(monkeypatch):
    now = [0.0]
    monkeypatch.setattr(bench_load, "clock", SimpleNamespace(perf_counter=lambda: now[0]))

    def get(wanted: str) -> str:
        now[0] += 2.0
        if wanted == "wrong":
            raise ValueError(wanted)
        return wanted

    monkeypatch.setattr(Pipelines, "get", staticmethod(get))
    with bench_load._building(3, "vulkan") as took:
        assert Pipelines.get("one") == "one"
        now[0] += 1.0
        with pytest.raises(ValueError, match="wrong"):
            Pipelines.get("wrong")
    assert took == [2.0, 2.0]
    assert Pipelines.get("after") == "after" and took == [2.0, 2.0]


def test_the_warm_up_neither_reads_nor_writes_a_cache_and_decodes_nothing(squares, monkeypatch):
    def refuse(*_: object) -> None:
        raise AssertionError("the warm-up did what the load is measured by")

    monkeypatch.setattr(scene_cache, "read_cache", refuse)
    monkeypatch.setattr(scene_cache, "Writer", refuse)
    monkeypatch.setattr(scene_cache, "maker", refuse)
    monkeypatch.setattr("common.gltf.images._decode", refuse)
    settings = bench_load.replace(
        bench_load.preset(bench_load.chapters.settings_class(3), "medium"), loading="wait"
    )
    with bench_load.ExitStack() as stack:
        try:
            device = bench_load.open_device(stack, "vulkan")
        except UnsupportedError as error:
            pytest.skip(f"no Vulkan: {error}")
        bench_load._warm_up(3, "vulkan", squares, SIZE, settings, device, "plain")
    assert caches(squares) == []


def test_small_textures_are_stored_as_the_large_ones_are():
    if not blocks.available():
        pytest.skip("etcpak is not installed")
    from chapters.ch03.logic.cached_images import compress

    pixels = np.full((4, 4, 4), 255, np.uint8)
    for use, format in (
        ((True, True, "rgba"), "bc7_srgb"),
        ((False, True, "r"), "bc4"),
        ((False, False, "gb"), "bc5"),
    ):
        chain = bench_load._Small("one", pixels, compress).chain(*use)
        assert chain is not None and chain.format == format and len(chain.levels) == (3 if use[1] else 1)
    assert bench_load._Small("one", pixels).chain(True, True, "rgba") is None
    assert isinstance(bench_load._Small("one", pixels), Image)
