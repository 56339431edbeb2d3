"""What the bench calls loading: which parts of a load it takes out, and that its warm-up leaves the rest cold."""

from __future__ import annotations

from contextlib import ExitStack
from functools import partial
from pathlib import Path
from types import SimpleNamespace

import pytest

from chapters.ch03.benches import load as bench_load
from chapters.ch03.benches import scene as bench_scene
from chapters.ch03.pipelines.vulkan import Pipelines
from chapters.ch03.scene_cache import cache
from chapters.ch03.scene_cache.images import CachedImage, compress, image_uses
from chapters.ch03.settings import Settings
from common.errors import DeviceError, UnsupportedError
from common.gltf import load_scene
from common.scene.primitive import nothing
from common.settings import preset, replaced
from tests.support.timing import least_times
from tools.bench.lessons import loads as bench_loads
from tools.bench.points import Subject
from tools.run.run import open_device

SIZE = (16, 16)
CHAINS = [(True, True, "rgba"), (False, True, "r"), (False, False, "gb")]


@pytest.fixture
def squares(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A document of two textures that are large enough for blocks, and caches that nobody else uses."""
    monkeypatch.setenv("STRATA_CACHE", str(tmp_path / "cache"))
    folder = tmp_path / "scene"
    folder.mkdir()
    return bench_scene.write(folder, 2, 64)


def load(path: Path, way: str) -> dict[str, float]:
    try:
        return bench_loads.once(3, "vulkan", path, SIZE, way)
    except UnsupportedError as error:
        pytest.skip(f"no Vulkan, or none that samples blocks: {error}")


def subject(device: object) -> Subject:
    return Subject(3, "vulkan", nothing("what is loaded"), SIZE, device)


def way(name: str) -> bench_load._Load:
    return bench_load._Load(subject(None), Path(), None, name)


def caches(path: Path) -> list[Path]:
    return [
        one for one in (cache.cache_file(path, compressed) for compressed in (False, True)) if one.exists()
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


def test_the_backend_of_a_load_need_not_be_named(squares):
    """As in `./strata bench 3` without --backend, where `auto` is passed on: pipelines are those of what was opened."""
    assert bench_loads.once(3, "auto", squares, SIZE, "plain")["pipelines_s"] > 0


def test_a_load_that_fails_in_its_process_is_told_by_its_last_line(tmp_path):
    with pytest.raises(
        DeviceError, match=r"^Loading nowhere in a process of its own failed: .*nowhere\.gltf"
    ):
        bench_loads.run(3, "auto", SIZE, tmp_path / "nowhere.gltf", "plain", tmp_path)


def test_what_any_scene_takes_is_measured_when_the_scene_is_gone(squares, monkeypatch):
    """Beside another renderer it would need memory that the load found there, and too much would be taken out."""
    alone, before = bench_load._alone, []

    def recorded(load: bench_load._Load, building: list[float]) -> float:
        before.append(dict(load.subject.device.alive))
        return alone(load, building)

    monkeypatch.setattr(bench_load, "_alone", recorded)
    load(squares, "plain")
    assert before and not [kind for kind, _ in before[0] if kind in ("VkBuffer", "VkImage", "VkPipeline")]


def test_the_time_of_pipelines_is_that_of_the_calls_that_build_them(monkeypatch):
    now = [0.0]
    monkeypatch.setattr(bench_load, "clock", SimpleNamespace(perf_counter=lambda: now[0]))

    def get(wanted: str) -> str:
        now[0] += 2.0
        if wanted == "wrong":
            raise ValueError(wanted)
        return wanted

    monkeypatch.setattr(Pipelines, "get", staticmethod(get))
    device = SimpleNamespace(capabilities=SimpleNamespace(backend="vulkan"))
    with bench_load._building(subject(device)) as took:
        assert Pipelines.get("one") == "one"
        now[0] += 1.0
        with pytest.raises(ValueError, match="wrong"):
            Pipelines.get("wrong")
    assert took == [2.0, 2.0]
    assert Pipelines.get("after") == "after" and took == [2.0, 2.0]


def test_the_warm_up_neither_reads_nor_writes_a_cache_and_decodes_nothing(squares, monkeypatch):
    def refuse(*_: object) -> None:
        raise AssertionError("the warm-up did what the load is measured by")

    monkeypatch.setattr(cache, "read_cache", refuse)
    monkeypatch.setattr(cache, "Writer", refuse)
    monkeypatch.setattr(cache, "maker", refuse)
    monkeypatch.setattr("common.gltf.images._decode", refuse)
    settings = replaced(preset(Settings, "medium"), loading="wait")
    with ExitStack() as stack:
        try:
            device = open_device(stack, "vulkan")
        except UnsupportedError as error:
            pytest.skip(f"no Vulkan: {error}")
        bench_load._warm_up(bench_load._Load(subject(device), squares, settings, "plain"))
    assert caches(squares) == []


@pytest.mark.needs("etcpak")
def test_small_textures_are_stored_as_the_large_ones_are(squares):
    scene = load_scene(squares, decode=False)
    uses = image_uses(scene)
    small = bench_load._small_images(way("blocks"), scene)
    assert len(small) == len(scene.images) and {len(ways) for ways in uses.values()} == {1}
    for number, (use,) in uses.items():
        (chain, large) = small[number].chain(*use), compress(scene.images[number].pixels, use)
        assert chain is not None and small[number].pixels.shape == (4, 4, 4)
        assert (chain.format, chain.swizzle) == (large.format, large.swizzle)
        assert len(chain.levels) == (3 if use[1] else 1)
    assert all(
        one.chain(*use) is None for one in bench_load._small_images(way("plain"), scene) for use in CHAINS
    )


@pytest.mark.feature("tools/bench")
@pytest.mark.needs("etcpak")
def test_what_no_cache_spares_is_the_scene_without_its_texels(squares, monkeypatch):
    """The cache is read and its geometry uploaded; none of its chains is, and its time counts as that of a load."""
    load(squares, "compress")
    asked = []
    monkeypatch.setattr(CachedImage, "chain", lambda *use: asked.append(use))
    opened = []
    monkeypatch.setattr(cache, "put_together", recorded(cache.put_together, opened))
    least = load(squares, "least")
    assert opened and not asked
    assert least["decoded_bytes"] == 2 * 4 * 4 * 4
    assert least["load_s"] + least["pipelines_s"] + least["renderer_s"] == pytest.approx(least["total_s"])


@pytest.mark.alone
@pytest.mark.feature("scene-cache/file")
@pytest.mark.needs("etcpak")
def test_a_cache_leaves_a_sixth_at_most_of_what_a_cache_can_spare(tmp_path, monkeypatch):
    """Textures come an order of magnitude faster, but for what has nothing to do with their texels.

    A load from the file takes P, from the cache of blocks C, and L without texels: buffers, images, descriptors and the
    records of objects, some tenths of a millisecond each in Python, which are made anew in every process. A cache that
    were read in no time would take L, and be P / L times as fast: 10 here, on two processors, and less on more, which
    decode at once. So not P / C is what a cache has in its hands but (P - L) / (C - L), which is 13 to 28 here.
    The bound leaves room for a machine that does other work meanwhile: C - L is some 15 ms, and one delay doubles it.
    """
    monkeypatch.setenv("STRATA_CACHE", str(tmp_path / "cache"))
    path = bench_scene.write(tmp_path, 16, 512)
    load(path, "compress")
    took = least_times(
        {name: partial(_seconds, path, name) for name in ("plain", "blocks", "least")}, spares_enough
    )
    assert spares_enough(took), took


def _seconds(path: Path, name: str) -> float:
    return load(path, name)["load_s"]


def spares_enough(took: dict[str, float]) -> bool:
    return took["plain"] - took["least"] >= 6 * (took["blocks"] - took["least"])


def test_reading_alone_is_measured_on_the_same_pictures_as_pillow(squares):
    read, pillow = load(squares, "read"), load(squares, "pillow")
    assert read["decoded_bytes"] == pillow["decoded_bytes"] == 2 * 64 * 64 * 4
    assert read["load_s"] == read["total_s"] > 0


def test_a_record_says_how_long_copies_ran_beside_drawing():
    made = bench_load.record(
        {"graphics": [(0.0, 4.0), (6.0, 8.0)], "transfer": [(1.0, 2.0), (3.0, 7.0), (9.0, 10.0)]}
    )
    assert (made["copies"], made["copies_ms"], made["beside_drawing_ms"]) == (3, 6.0, 3.0)
    alone = bench_load.record({"graphics": [(0.0, 4.0)]})
    assert (alone["queues"], alone["copies_ms"], alone["beside_drawing_ms"]) == (["graphics"], 0.0, 0.0)


def recorded(call, calls):
    """Return `call`, which notes in `calls` that it was called."""

    def run(*arguments):
        calls.append(arguments)
        return call(*arguments)

    return run
