"""FXAA: its decisions against float64, its symmetry, what it must leave alone, and the aliasing that it removes."""

from __future__ import annotations

import numpy as np
import pytest

from chapters.ch11.post.finish import LEAST_CONTRAST
from chapters.ch11.settings import Settings
from common.images.color import decode_srgb
from common.settings import replaced
from tests.support.glowing import glowing
from tests.support.scenes import facing
from tests.twins import finish as twin

pytestmark = pytest.mark.variants("vulkan", "gl")

EV = -0.2630344058337938
"""The EV100 of exposure 1: nits are picture values."""

STEPS = 5
MARGIN = STEPS + 2
"""Pixels around each tile: no walk along an edge reaches another tile."""

TILE = 18
PLAIN = Settings(
    ambient=0.0, default_light=False, color_format="rgba32f", msaa=1, tone_curve="none", fxaa_steps=STEPS
)


def codes(chapter, picture, **knobs):
    """Return the codes (H, W, 3) of the finished picture of an image of codes."""
    light = decode_srgb(np.asarray(picture, np.float64) / 255.0)
    size = picture.shape[1::-1]
    with chapter.open(glowing(np.float32(light)), size, replaced(PLAIN, **knobs)) as opened:
        return opened.render(facing(ev100=EV)).image("color").astype(int)


def symmetries(tile):
    """Return a tile, turned and mirrored in all eight ways, each with how to bring it back."""
    ways = []
    for turn in (False, True):
        for rows in (1, -1):
            for columns in (1, -1):
                ways.append((turn, rows, columns))
    there = [(np.swapaxes(tile, 0, 1) if turn else tile)[::y, ::x] for turn, y, x in ways]

    def back(number, found):
        turn, y, x = ways[number]
        found = found[::y, ::x]
        return np.swapaxes(found, 0, 1) if turn else found

    return there, back


def shapes():
    """Return a tile of grey noise in which lines, corners and single pixels stand: all ties that there are."""
    rng = np.random.default_rng(4)
    tile = np.full((TILE, TILE, 3), 60)
    tile[2:6, 2:9] = 220
    tile[8, 2:14] = 250
    tile[10:16, 10:16] = np.where(np.arange(6)[:, None] >= np.arange(6), 240, 20)[..., None]
    tile[12, 3] = 255
    tile[14:17, 2:8] = rng.integers(0, 256, (3, 6, 3))
    return tile


def board(tiles):
    """Return tiles in a row with margins, and where each begins."""
    wide = TILE + 2 * MARGIN
    picture = np.full((wide, wide * len(tiles), 3), 60)
    for number, tile in enumerate(tiles):
        picture[MARGIN : MARGIN + TILE, wide * number + MARGIN :][:, :TILE] = tile
    return picture, [wide * number + MARGIN for number in range(len(tiles))]


@pytest.mark.feature("postprocess/fxaa")
def test_it_is_that_of_its_definition_and_commutes_with_mirrors_and_transposition(chapter):
    there, back = symmetries(shapes())
    picture, places = board(there)
    before, after = codes(chapter, picture), codes(chapter, picture, fxaa=True)
    assert np.abs(before - picture).max() == 0
    wanted = 255 * twin.fxaa(before / 255.0, 0.125, LEAST_CONTRAST, 0.75, STEPS)
    assert np.abs(after - wanted).max() < 0.6
    assert (np.abs(after - before).max(-1) > 4).mean() > 0.02
    found = [back(number, after[MARGIN : MARGIN + TILE, x : x + TILE]) for number, x in enumerate(places)]
    for other in found[1:]:
        assert np.array_equal(found[0], other)


@pytest.mark.core
@pytest.mark.feature("postprocess/fxaa")
def test_constant_and_low_contrast_pictures_stay_and_edges_do_not(chapter):
    """To the bit: a constant, a slow ramp, noise below the threshold, in dark and in bright."""
    rng = np.random.default_rng(5)
    picture = np.full((24, 64, 3), 137)
    picture[:, 16:32] = np.arange(16)[:, None] + np.array([100, 100, 90])
    picture[:8, 32:48] = rng.integers(0, 10, (8, 16, 1))  # below 1/24 of white
    picture[8:, 32:48] = 5
    picture[:, 48:] = 200 + rng.integers(0, 24, (24, 16, 1))  # below 1/8 of the brightest
    for column in (16, 32, 48):  # the steps between are edges
        picture[:, column - 1 : column + 1] = picture[:, column - 1 : column]
    before, after = codes(chapter, picture), codes(chapter, picture, fxaa=True)
    inner = np.ones(picture.shape[:2], bool)
    for column in (16, 32, 48):
        inner[:, column - 3 : column + 4] = False
    inner[6:10, 32:48] = False
    assert np.array_equal(before[inner], after[inner])
    assert not np.array_equal(before, after)


@pytest.mark.feature("postprocess/fxaa")
def test_a_diagonal_edge_loses_aliasing(chapter):
    """The error of a binary edge against the area that it covers, at pixels that the edge crosses.

    It falls to less than a half at all slopes but 45 degrees. There each step of the edge is one pixel long, so an edge
    has no ends to go by, and only details are smoothed.
    """
    side, factors = 48, []
    edges = [(1.0, 0.1), (1.0, 1 / 3), (1.0, 0.62), (0.2, 1.0), (-1.0, 0.4), (0.8, 1.0), (1.0, 1.0)]
    picture = np.zeros((side, side * len(edges), 3), int)
    truth = np.zeros((side, side * len(edges)))
    y, x = np.indices((side, side)) + 0.5
    for number, normal in enumerate(edges):
        middle = side / 2 * (normal[0] + normal[1]) + 0.137
        columns = slice(side * number, side * (number + 1))
        picture[:, columns] = 255 * (x * normal[0] + y * normal[1] < middle)[..., None]
        truth[:, columns] = twin.covered(side, side, normal, middle)
    found = codes(chapter, picture, fxaa=True, fxaa_steps=16)[..., 1] / 255.0
    for number in range(len(edges)):
        part = np.s_[12:-12, side * number + 2 : side * (number + 1) - 2]
        crossed = (truth[part] > 0) & (truth[part] < 1)
        off, on = (np.abs(it - truth)[part][crossed].mean() for it in (picture[..., 1] / 255.0, found))
        factors.append(off / on)
    assert min(factors[:-1]) > 1.9 and np.median(factors) > 3.5 and factors[-1] > 1.0, factors
