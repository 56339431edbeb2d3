"""References in tiles have the paths of the whole picture, in one process and by workers; sentences name the tile."""

from __future__ import annotations

from collections import Counter
from functools import partial

import numpy as np
import pytest

import chapters
from chapters import scenes
from tests.support import sweep_parts
from tests.support.path_scenes import CORNER, room
from tools.reference import command as single
from tools.reference import settings, tiles, tracing
from tools.reference.sweep import command, pools, work

pytestmark = pytest.mark.feature("path-tracer/accumulation")

SIZE = (18, 13)
"""Of 3 x 2 tiles of 6 x 7 pixels at most 8 wide: the lower ones overlap the upper ones by a row."""


@pytest.mark.parametrize(
    ("size", "count", "of_each"),
    [
        ((512, 512), 1, (512, 512)),
        ((640, 360), 1, (640, 360)),
        ((16384, 16), 1, (16384, 16)),
        ((1920, 1080), 12, (480, 360)),
        ((514, 512), 2, (257, 512)),
        ((1537, 1025), 12, (385, 342)),
        ((16384, 17), 32, (512, 17)),
    ],
)
def test_tiles_of_one_size_cover_a_picture_and_overlap_little(size, count, of_each):
    cut = tiles.tiles_of(size)
    assert (len(cut), {tile.size for tile in cut}) == (count, {of_each})
    assert [tile.number for tile in cut] == [*range(count)] and cut[0].first == (0, 0)
    covered = np.zeros(size[::-1], np.uint8)
    for tile in cut:
        here = covered[tile.place]
        assert here.shape == of_each[::-1]
        here += 1
    assert covered.min() == 1 and (covered > 1).mean() < 0.005


@pytest.fixture
def sizes(monkeypatch):
    """Return a list of the sizes of renderers that are opened."""
    found, opened = [], chapters.open

    def noted(*words, **options):
        found.append(options["size"])
        return opened(*words, **options)

    monkeypatch.setattr(chapters, "open", noted)
    return found


@pytest.mark.parametrize("backend", ["vulkan", pytest.param("gl", marks=pytest.mark.long)])
@pytest.mark.parametrize(
    ("of", "filter", "overrides"),
    [
        ("cornell", "box", []),
        ("cornell", "centre", ["aperture=2", "path_sequence=sobol"]),
        ("room", "box", []),
    ],
)
def test_tiles_change_no_path_of_a_reference(backend, of, filter, overrides, sizes, monkeypatch):
    """One run traces the whole picture, and another one goes on in tiles.

    Also through a lens by Sobol's sequence, and with a pane, of which a hash of the pixel lets some paths through.
    There the light of the sky may differ in its last bits: llvmpipe filters texels of neighbours together.
    """
    own, of_paths = settings.chapter_settings(12, overrides)
    chosen = settings.tracer_settings(own, filter, 3, of_paths)
    scene, camera = (room(), CORNER) if of == "room" else (scenes.load(of), None)
    task = tracing.task_of(chosen, scene, camera, SIZE, 0.0, backend)
    whole, cut = (tracing.Keeper(None, task.facts(), SIZE) for _ in range(2))
    told = []
    tracing.trace(task, whole, 0.0, 20, lambda part, text: told.append(text))
    assert not any("tile" in text for text in told)
    tracing.trace(task, cut, 0.0, 7)
    monkeypatch.setattr(tiles, "LARGEST", 8)
    tracing.trace(task, cut, 0.0, 20, lambda part, text: told.append(text))
    assert sizes == [SIZE, SIZE, (6, 7)]
    assert cut.sums.paths == 20 and np.ptp(cut.sums.picture) > 0.1 * whole.sums.picture.mean() > 0.0
    bound = 1e-6 if scene.environment else 0.0
    np.testing.assert_allclose(cut.sums.light, whole.sums.light, rtol=bound)
    np.testing.assert_allclose(cut.sums.squares, whole.sums.squares, rtol=bound)
    assert "8 paths a pixel, tile 1 of 6" in told and told.count("tile 6 of 6") == 1


def test_a_block_that_is_traced_again_has_the_same_bits():
    """Nothing has changed between the two frames, as where two references of a sweep are equal and not kept."""
    own, of_paths = settings.chapter_settings(12)
    task = tracing.task_of(
        settings.tracer_settings(own, "box", 0, of_paths), scenes.load("cornell"), None, SIZE, 0.0, "vulkan"
    )
    jobs = [(*tiles.tiles_of(SIZE), first, 1) for first in (0, 0, 1)]
    with tracing.opened(task, SIZE) as renderer:
        first, again, later = (
            [image.copy() for image in found] for found in tracing.blocks_of(renderer, task, jobs)
        )
    assert np.array_equal(first[0], again[0]) and np.array_equal(first[1], again[1])
    assert not np.array_equal(first[0], later[0])


ONE = """
chapter = 12
scene = "cornell"
size = "18x13"
seed = 3
paths = 3
error = 0
format = "npy"
"""


@pytest.mark.needs("distributed")
def test_a_worker_that_ends_costs_its_tile(strata, vulkan_instance, tmp_path, monkeypatch):
    """Two workers share one picture, whose bits are those of one process without tiles."""
    alone, _ = tracing.reference(12, scenes.load("cornell"), None, SIZE, 0.0, paths=3, seed=3, cached=False)
    monkeypatch.setattr(tiles, "LARGEST", 8)
    monkeypatch.setattr(work, "MOST_BLOCKS", 2)  # paths 0 and 1, and path 2
    monkeypatch.setattr(command, "Workers", partial(pools.Workers, run=sweep_parts.traced_or_end))
    (tmp_path / "s.toml").write_text(ONE)
    code, _, err = strata("reference", "--sweep", "s.toml", "--out", "a", "--workers", 2, "--no-cache")
    assert code == 0, err
    assert np.array_equal(np.load(tmp_path / "a" / "ch12-cornell.npy"), alone)
    traced = Counter((tmp_path / "a" / "ch12-cornell.txt").read_text().splitlines())
    assert {*traced} == {f"{first} {tile}" for first in (0, 2) for tile in range(6)}
    assert traced["0 3"] == 2


def test_a_part_is_told_by_its_paths_and_its_tile():
    request = single.Request(1, size=SIZE)
    whole = work.Part(request, (), 0, 16, (2, 2), tiles.tiles_of(SIZE)[0])
    tile = tiles.Tile(4, (6, 6), (6, 7))
    assert pools._spoken(whole) == "the part with its paths 16 to 19"
    assert pools._spoken(work.Part(request, (), 0, 16, (2, 2), tile)) == (
        "the part with its paths 16 to 19 in the tile of 6x7 pixels at 6,6"
    )
