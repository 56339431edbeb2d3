"""The study sparse-texture: codes and texels of every tile while memory moves, and the same picture by a table."""

from __future__ import annotations

import math

import numpy as np
import pytest

import chapters
from chapters import studies
from chapters.ch08.studies.sparse_texture import NONE, Residency, Settings, sparse_image, vulkan, wanted
from common.errors import UnsupportedError
from tests.support.drivers import needs_feature

pytestmark = pytest.mark.feature("sparse/page-pool")
only_vulkan = pytest.mark.parametrize("stage", ["vulkan"], indirect=True, scope="module")
WHICH, SIZE, TEXELS = "8/sparse-texture", (96, 64), 128 * 128
TIMES = (0.0, 0.4, 0.8, 0.8, 2.5, 5.0, 0.1)
WAYS = [("sparse", True), ("table", True), ("sparse", False)]


def has_memory(time, pages=20, shared=True):
    """Return (8, 8) which tiles have memory: the shared column, and the nearest ones that are left."""
    spot = 4.0 + 2.2 * math.cos(time), 4.0 + 2.2 * math.sin(time)
    tiles = [(math.hypot(x + 0.5 - spot[0], y + 0.5 - spot[1]), y, x) for y in range(8) for x in range(8)]
    alone = sorted(tile for tile in tiles if not shared or tile[2] > 0)[: pages - shared]
    found = np.zeros((8, 8), bool)
    found[:, 0] = shared
    for _, y, x in alone:
        found[y, x] = True
    return found


def texture(shared=True):
    """Return (1024, 1024, 3) uint8 of the whole texture, as if all of it had memory."""
    y, x = np.mgrid[:1024, :1024]
    tile = (y // 128) * 8 + x // 128
    if shared:
        first = x < 128
        tile, y = np.where(first, 0, tile), np.where(first, y % 128, y)
    ring = ((x - 512) ** 2 + (y - 512) ** 2) >> 10
    bits = ((tile + 1) * 2654435761) & 0xFFFFFFFF
    edge = np.minimum(np.minimum(x % 128, 127 - x % 128), np.minimum(y % 128, 127 - y % 128)) < 3
    bright = np.where(edge, 64, 128 + ring % 8 * 16)
    hues = [60 + ((bits >> shift) & 127) + more for shift, more in ((8, 60), (16, 40), (24, 60))]
    return np.stack([hue * bright // 256 for hue in hues], -1).astype(np.uint8)


def picture(time, size=SIZE, **knobs):
    """Return (H, W, 3) uint8: texels at the centres of pixels, a grid where there is no memory."""
    width, height = size
    x = (2 * np.arange(width)[None] + 1) * 1024 // (2 * width)
    y = (2 * np.arange(height)[:, None] + 1) * 1024 // (2 * height)
    there = has_memory(time, **knobs)[y // 128, x // 128]
    grid = np.where((x % 32 < 4) | (y % 32 < 4), 64, 46)[..., None].astype(np.uint8)
    return np.where(there[..., None], texture(knobs.get("shared", True))[y, x], grid)


def ready(stage, way):
    if way == "sparse" and stage.backend == "vulkan":
        needs_feature(stage.device, "sparse")


@pytest.mark.parametrize(("way", "shared"), WAYS)
def test_codes_and_texels_are_right_on_every_texel_while_memory_moves(stage, way, shared):
    """In all frames, forwards and back. What a texel without memory returns is never looked at: it may be anything."""
    ready(stage, way)
    settings = Settings(way=way, shared=shared)
    with stage.open(WHICH, SIZE, settings=settings) as renderer:
        assert renderer.sparse == (way == "sparse" and stage.backend == "vulkan")
        view = chapters.view_of(renderer)
        for time in TIMES:
            frame = renderer.render(view, time)
            there = has_memory(time, shared=shared)
            assert (frame.image("color")[..., :3] == picture(time, shared=shared)).all(), time
            work = frame.work
            counts = renderer.last_counts
            assert (counts[:, 0].reshape(8, 8) == TEXELS * there).all() and not counts[:, 1].any()
            assert work["resident_texels"] == TEXELS * there.sum() and work["wrong_texels"] == 0
            assert work["tiles"] == there.sum() and work["bytes"] == 20 * 65536 < 64 * 65536


def test_a_frame_binds_what_changed_alone(stage):
    ready(stage, "sparse")
    with stage.open(WHICH, SIZE) as renderer:
        view = chapters.view_of(renderer)
        before = np.zeros((8, 8), bool)
        for time in TIMES:
            work, now = renderer.render(view, time).work, has_memory(time)
            assert work["bound"] == (now & ~before).sum() and work["unbound"] == (before & ~now).sum()
            assert work["dispatches"] == 1 + int((now & ~before).any())
            before = now
        assert work["bound"] > 0


@pytest.mark.parametrize("pages", [1, 2, 64])
def test_a_pool_of_one_page_and_one_of_all(stage, pages):
    ready(stage, "sparse")
    for shared in (True, False):
        with stage.open(WHICH, SIZE, settings=Settings(pages=pages, shared=shared)) as renderer:
            frame = renderer.render(chapters.view_of(renderer), 1.0)
            assert (frame.image("color")[..., :3] == picture(1.0, pages=pages, shared=shared)).all()
            assert frame.work["wrong_texels"] == 0


@only_vulkan
def test_a_device_without_sparse_residency_shows_the_same_picture_by_a_table(stage):
    with stage.open(WHICH, SIZE, without=("sparse",)) as renderer:
        frame = renderer.render(chapters.view_of(renderer), 0.4)
        assert not renderer.sparse and (frame.image("color")[..., :3] == picture(0.4)).all()
        assert frame.work["resident_texels"] == TEXELS * has_memory(0.4).sum()


# --- what must be noticed ---------------------------------------------------------------------------------------------


@only_vulkan
@pytest.mark.parametrize(
    ("fault", "said"), [("left out", "resident_texels"), ("another page", "wrong_texels")]
)
def test_a_wrong_bind_is_noticed(stage, monkeypatch, fault, said):
    ready(stage, "sparse")
    right = sparse_image.SparseImage.bind

    def wrong(self, tiles, page):
        if fault == "left out":
            right(self, tiles[:-1], page)
        else:
            changed = page.copy()
            changed[tiles[-1]] = page[tiles[-2]]
            right(self, tiles, changed)

    monkeypatch.setattr(sparse_image.SparseImage, "bind", wrong)
    with stage.open(WHICH, SIZE) as renderer:
        work = renderer.render(chapters.view_of(renderer)).work
    expected = {"resident_texels": TEXELS * int(has_memory(0.0).sum()), "wrong_texels": 0}
    assert work[said] != expected[said]


@only_vulkan
def test_what_a_device_cannot_is_one_sentence_and_leaves_nothing(stage, monkeypatch):
    ready(stage, "sparse")
    alive = dict(stage.device.alive)
    monkeypatch.setattr(sparse_image, "PAGE_BYTES", 1 << 17)
    with pytest.raises(UnsupportedError, match=r"^The device has other pages .* --set way=table\.$"):
        stage.open(WHICH, SIZE)
    monkeypatch.undo()
    monkeypatch.setattr(
        vulkan, "lacks", lambda *asked: ("sparseResidencyAliased" in asked and "it lacks that") or ""
    )
    with pytest.raises(UnsupportedError, match=r"aliased memory: it lacks that; set shared=no\.$"):
        stage.open(WHICH, SIZE)
    with stage.open(WHICH, SIZE, settings=Settings(shared=False)) as renderer:
        assert renderer.sparse
    assert stage.device.alive == alive


# --- which page is whose ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("pages", "shared"), [(20, True), (20, False), (1, True), (1, False), (64, False), (64, True)]
)
def test_no_page_has_two_owners_and_who_stays_keeps_it(pages, shared):
    """Pages are fewer than tiles that want one: the nearest get them. Only the shared page is in several tiles."""
    residency = Residency(Settings(pages=pages, shared=shared))
    content = np.full(pages, -1)
    for time in np.arange(0.0, 13.0, 0.17):
        before = residency.page.copy()
        changed, fills = residency.update(float(time))
        there = has_memory(time, pages, shared).reshape(-1)
        assert ((residency.page != NONE) == there).all() and (
            wanted(residency.settings, float(time)) == there
        ).all()
        used = residency.page[there]
        assert used.max() < pages
        alone = residency.page[there & ~(shared & (np.arange(64) % 8 == 0))]
        assert len({*alone.tolist()}) == len(alone) and not (shared and 0 in alone)
        stays = (before != NONE) & there
        assert (residency.page[stays] == before[stays]).all()
        assert set(changed) == set(np.flatnonzero(before != residency.page))
        content[fills["page"]] = fills["content"]
        assert (content[used] == residency.content[there]).all(), "each tile finds its own pattern"
        assert len(fills) <= pages


def test_the_study_is_found_and_has_both_backends():
    assert studies.backends(WHICH) == ("vulkan", "gl")
