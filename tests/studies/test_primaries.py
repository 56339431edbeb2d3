"""The study primaries: those of one submission are drawn in the order of its array, by whomever they were recorded."""

from __future__ import annotations

import numpy as np
import pytest

import chapters
from chapters.ch03.studies.primaries import SQUARES, Settings

SIDE = 48
CODES = 1 / 0.6
"""Each layer may round its colour and what it is laid over, by half a code each; those above keep 0.4 of that."""

pytestmark = pytest.mark.parametrize("stage", ["vulkan"], indirect=True, scope="module")
"""OpenGL has no command buffers."""


def laid_over(order: list[int]) -> np.ndarray:
    """Return the picture (SIDE, SIDE, 3) in codes, as the shaders' text says it: a square is 18 pixels wide."""
    picture = np.full((SIDE, SIDE, 3), (0.05, 0.05, 0.06))
    for number in order:
        x, y = number + 4, number * 7 % 24 + 4
        color = np.array([number * 5 % 8, number * 3 % 8, number % 8]) / 7
        part = picture[y : y + 18, x : x + 18]
        part[...] = color * 0.6 + part * 0.4
    return picture * 255


@pytest.mark.feature("recording/primary-and-secondary")
def test_primaries_are_drawn_in_the_order_of_the_array(stage):
    """Also where frames follow one another, and squares are drawn in numbers that no count of primaries divides."""
    truth = stage.draw("3/primaries", (SIDE, SIDE), settings=Settings(primaries=1, threads=0))["color"]
    assert np.abs(truth[..., :3] - laid_over([*range(SQUARES)])).max() <= CODES
    for primaries, threads in ((2, 0), (4, 1), (5, 2), (24, 3)):
        with stage.open(
            "3/primaries", (SIDE, SIDE), settings=Settings(primaries=primaries, threads=threads)
        ) as renderer:
            for _ in range(4):
                picture = renderer.render(chapters.view_of(renderer)).image("color")
                assert np.array_equal(picture, truth), (primaries, threads)


@pytest.mark.feature("recording/primary-and-secondary")
def test_another_array_is_another_picture(stage):
    found = stage.draw("3/primaries", (SIDE, SIDE), settings=Settings(primaries=24, order="reversed"))[
        "color"
    ]
    assert np.abs(found[..., :3] - laid_over([*range(SQUARES)][::-1])).max() <= CODES
    assert np.abs(found[..., :3] - laid_over([*range(SQUARES)])).max() > 50
