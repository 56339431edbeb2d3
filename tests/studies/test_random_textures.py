"""The study random-textures: every pixel shows the very texel that its lot names, at edges of triangles too."""

from __future__ import annotations

import numpy as np
import pytest

import chapters
from backends.vulkan.device import Device
from chapters import studies
from chapters.ch02.pipelines.spirv.numbers import Op
from chapters.ch02.studies.random_textures import CELL, Settings, grid
from common.errors import UnsupportedError
from common.images.palette import scrambled
from tests.support.drivers import needs_feature

SIZE = (150, 100)
FLAT, VOLUMES, SIDE = 24, 8, 8
NON_UNIFORM = 5300  # the decoration, in the SPIR-V specification


def noise(stage, monkeypatch) -> tuple[np.ndarray, np.ndarray]:
    """Let the study draw textures of which no two texels are alike, and return them."""
    rng = np.random.default_rng(11)
    flat = rng.integers(0, 256, (FLAT, SIDE, SIDE, 4), dtype=np.uint8)
    solid = rng.integers(0, 256, (VOLUMES, SIDE, SIDE, SIDE, 4), dtype=np.uint8)
    module = chapters.renderer_module("2/random-textures", stage.backend)
    monkeypatch.setattr(module.Renderer, "textures", staticmethod(lambda: flat))
    monkeypatch.setattr(module.Renderer, "volumes", staticmethod(lambda: solid))
    return flat, solid


def triangles() -> np.ndarray:
    """Return the number of the triangle at each pixel's centre (H, W), by where its corners are said to lie."""
    y, x = np.mgrid[: SIZE[1], : SIZE[0]] + 0.5
    # In cells, from the first one's corner; below the falling diagonal lies the first triangle of a cell.
    right, down = (x - 0.25) / CELL + 1.0, (y - 0.125) / CELL + 1.0
    column, row = np.floor(right), np.floor(down)
    upper = right - column > down - row
    return (2 * (row * grid(SIZE)[0] + column) + upper).astype(np.uint32)


def needs_bindless(stage):
    """OpenGL has another way to the same picture, and Vulkan has none."""
    if stage.backend == "vulkan":
        needs_feature(stage.device, "bindless")


def expected(per: str, flat: np.ndarray, solid: np.ndarray) -> np.ndarray:
    y, x = np.mgrid[: SIZE[1], : SIZE[0]].astype(np.uint32)
    lot = scrambled(triangles()) if per == "triangle" else scrambled(x + scrambled(y))
    number, z = (lot % 32).astype(int), (lot >> 8) % 8
    in_flat = flat[np.minimum(number, FLAT - 1), y % 8, x % 8]
    in_solid = solid[np.maximum(number - FLAT, 0), z, y % 8, x % 8]
    return np.where((number < FLAT)[..., None], in_flat, in_solid)[..., :3]


@pytest.mark.feature("bindless/nonuniform-indexing")
@pytest.mark.parametrize("per", ["pixel", "triangle"])
def test_every_pixel_shows_the_texel_that_its_lot_names(stage, monkeypatch, per):
    needs_bindless(stage)
    flat, solid = noise(stage, monkeypatch)
    picture = stage.draw("2/random-textures", SIZE, settings=Settings(per=per))["color"]
    assert (picture == expected(per, flat, solid)).all()


@pytest.mark.feature("bindless/nonuniform-indexing")
def test_the_lots_take_every_texture_and_neighbours_differ():
    y, x = np.mgrid[: SIZE[1], : SIZE[0]].astype(np.uint32)
    for lot in (scrambled(x + scrambled(y)), scrambled(triangles())):
        number = lot % 32
        assert len(np.unique(number)) > 28
    assert (np.diff((scrambled(x + scrambled(y)) % 32).astype(int), axis=1) == 0).mean() < 0.05


def decorated(renderer) -> int:
    """Return how many results of the fragment shader are marked as non-uniform, by a walk over its words."""
    code = next(iter(renderer.pipelines._built.values())).code.codes[1]
    words, at, found = np.frombuffer(code, np.uint32), 5, 0
    while at < len(words):
        found += bool(words[at] & 0xFFFF == Op.DECORATE and words[at + 2] == NON_UNIFORM)
        at += int(words[at] >> 16)
    return found


@pytest.mark.parametrize("stage", ["vulkan"], indirect=True, scope="module")
def test_the_setting_marks_the_index_and_without_it_only_one_lot_a_group_counts(stage, monkeypatch):
    """What happens without the mark is undefined; here is what Mesa's software driver makes of it."""
    needs_bindless(stage)
    flat, solid = noise(stage, monkeypatch)
    marks, wrong = {}, {}
    for per in ("pixel", "triangle"):
        for marked in (True, False):
            settings = Settings(per=per, nonuniform=marked)
            with stage.open("2/random-textures", SIZE, settings=settings) as renderer:
                picture = renderer.render(chapters.view_of(renderer)).image("color")
                marks[marked] = decorated(renderer)
            wrong[per, marked] = (picture != expected(per, flat, solid)).any(axis=2).mean()
    # The chapter's own functions for slots stay marked, and are not called; the study's two are the rest.
    assert marks[True] > marks[False]
    assert wrong["pixel", True] == wrong["triangle", True] == 0
    if stage.device.capabilities.is_software:
        assert wrong["pixel", False] > 0.3 and wrong["triangle", False] == 0


@pytest.mark.feature("bindless/nonuniform-indexing")
def test_a_device_without_descriptor_indexing_is_refused_in_a_sentence(vulkan_instance):
    with Device(vulkan_instance, without={"bindless"}) as device:
        scene = studies.load("2/random-textures", None)
        with pytest.raises(
            UnsupportedError, match="takes descriptor indexing, and this device is used without it"
        ):
            chapters.open("2/random-textures", "vulkan", scene=scene, size=SIZE, device=device)
