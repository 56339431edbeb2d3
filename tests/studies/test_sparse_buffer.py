"""The study sparse-buffer: what was written once is found wherever its pages are bound, and nothing else is read."""

from __future__ import annotations

import math

import numpy as np
import pytest

import chapters
from chapters.ch08.studies.sparse_buffer import Settings, vulkan
from common.errors import UnsupportedError
from common.images.palette import id_color
from tests.support.bounds import codes_off
from tests.support.drivers import needs_feature

pytestmark = pytest.mark.feature("sparse/page-pool")
only_vulkan = pytest.mark.parametrize("stage", ["vulkan"], indirect=True, scope="module")
WHICH, SIZE, WORDS, PLACES = "8/sparse-buffer", (128, 128), 16384, 64
TIMES = (0.0, 0.25, 0.3, 1.0, 15.9, 100.0, 0.0)


@pytest.fixture
def pages_stage(stage):
    """The Vulkan device, if it binds pages of buffers."""
    needs_feature(stage.device, "sparse")
    if ("VkPhysicalDeviceFeatures2", "sparseResidencyBuffer") not in stage.device.physical.bits:
        pytest.skip("the device binds no pages of buffers")
    return stage


def places_at(time, pages=24):
    """Return {place: page} at a time."""
    return {(3 * page + math.floor(4 * time)) % PLACES: page for page in range(pages)}


def content(page):
    """Return (WORDS,) uint32 of a page."""
    return np.array(
        [page << 24 | ((i * 2654435761 + 40503 * page) % 2**32) >> 8 for i in range(WORDS)], np.uint32
    )


@only_vulkan
def test_pages_move_and_their_content_with_them(pages_stage):
    """It is written in the first frame alone. Later frames bind places, and copy and write nothing."""
    with pages_stage.open(WHICH, SIZE) as renderer:
        view, before = chapters.view_of(renderer), {}
        for number, time in enumerate(TIMES):
            work, now = renderer.render(view, time).work, places_at(time)
            assert work["read_words"] == 24 * WORDS and work["wrong_words"] == 0, time
            assert (renderer.last_counts[:, 0] == [WORDS * (place in now) for place in range(PLACES)]).all()
            assert work["wrote"] == (24 * 65536 if number == 0 else 0)
            changed = [place for place in range(PLACES) if before.get(place) != now.get(place)]
            assert work["bound"] == sum(place in now for place in changed)
            assert work["unbound"] == sum(place not in now for place in changed)
            assert work["bytes"] == 24 * 65536 < renderer.buffer.size == PLACES * 65536
            before = now
        words = renderer.download(renderer.buffer, vulkan.WRITTEN).view(np.uint32).reshape(PLACES, WORDS)
        for place, page in before.items():
            assert (words[place] == content(page)).all()


@only_vulkan
@pytest.mark.parametrize("time", [0.0, 1.3])
def test_the_picture_has_the_colours_of_the_words(pages_stage, time):
    """The picture is 128 pixels wide: each shows one word of the 256 of its cell."""
    image = pages_stage.draw(WHICH, SIZE, time)["color"][..., :3].astype(float)
    cells = image.reshape(8, 16, 8, 16, 3).transpose(0, 2, 1, 3, 4).reshape(64, 16, 16, 3)
    now = places_at(time)
    edge = np.zeros((16, 16), bool)
    edge[0] = edge[:, 0] = True
    for place in range(PLACES):
        if place not in now:
            assert (cells[place] == np.where(edge, 64, 46)[..., None]).all()
            continue
        words = content(now[place])[:: WORDS // 256].reshape(16, 16)
        bright = np.where(edge, 0.3, 0.7 + 0.3 * (words & 0xFFFFFF) / 0xFFFFFF)
        expected = 255 * bright[..., None] * id_color(np.array([now[place]], np.uint32))[0]
        assert np.abs(cells[place] - expected).max() <= codes_off(pages_stage.device) + 0.01


@only_vulkan
@pytest.mark.parametrize("pages", [1, 64])
def test_one_page_and_all_of_them(pages_stage, pages):
    with pages_stage.open(WHICH, SIZE, settings=Settings(pages=pages)) as renderer:
        for time in (0.0, 3.0):
            work = renderer.render(chapters.view_of(renderer), time).work
            assert work["read_words"] == pages * WORDS and work["wrong_words"] == 0
        assert work["unbound"] == (1 if pages == 1 else 0)


@only_vulkan
def test_pages_in_each_other_s_place_are_noticed(pages_stage, monkeypatch):
    """Words that are equal in both pages would count as right: only the upper 8 bits are never equal."""
    right = vulkan.bind

    def swapped(device, image, buffer, binds):
        first, second = [one for one in binds if "memory" in one][:2]
        first["memoryOffset"], second["memoryOffset"] = second["memoryOffset"], first["memoryOffset"]
        right(device, image, buffer, binds)

    with pages_stage.open(WHICH, SIZE) as renderer:
        view = chapters.view_of(renderer)
        assert renderer.render(view, 0.0).work["wrong_words"] == 0
        monkeypatch.setattr(vulkan, "bind", swapped)
        assert renderer.render(view, 1.0).work["wrong_words"] == 2 * WORDS


@only_vulkan
def test_what_cannot_be_is_one_sentence_and_leaves_nothing(stage, strata, monkeypatch):
    alive = dict(stage.device.alive)
    with pytest.raises(
        UnsupportedError, match=r"some pages have no memory, but it is switched off by --without\.$"
    ):
        stage.open(WHICH, SIZE, without=("sparse",))
    monkeypatch.setattr(vulkan, "lacks", lambda *asked: asked[-1] + " is missing")
    with pytest.raises(UnsupportedError, match=r"but sparseResidencyBuffer is missing\.$"):
        stage.open(WHICH, SIZE)
    monkeypatch.setattr(vulkan, "lacks", lambda *asked: "")
    monkeypatch.setattr(vulkan, "PAGE_BYTES", 6 << 12 | 2)  # no device has pages that divide this
    with pytest.raises(UnsupportedError, match=r"^The device binds \d+ bytes at a time"):
        stage.open(WHICH, SIZE)
    assert stage.device.alive == alive
    code, _, said = strata("run", WHICH, "--backend", "gl", "--out", "x.png")
    assert code == 2 and "has no OpenGL version" in said and said.count("\n") == 1
