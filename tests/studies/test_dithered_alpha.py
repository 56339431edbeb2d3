"""The study dithered-alpha: survivors of a tile by the exact table, in the function and in pictures."""

from __future__ import annotations

import numpy as np
import pytest

from chapters.ch01.studies.dithered_alpha import Settings
from tests.support.bounds import codes_off

ALPHAS = (0.5, 0.54, 0.6, 0.7, 0.75, 0.8, 0.9, 0.95, 1.0)
TABLE = {
    0.5: (0, 1, 3, 6, 8, 10, 13, 15, 16),
    0.54: (0, 0, 2, 5, 7, 8, 12, 13, 15),
    0.75: (0, 0, 0, 0, 0, 1, 5, 6, 8),
}
"""Threshold -> pixels of a 4 x 4 tile that are drawn, for each of ALPHAS: counted in exact fractions."""

# Rows of pixels from the top. The printed tuples are columns: x chooses the tuple, y the number in it.
TILE = np.array([(1, 9, 3, 11), (13, 5, 15, 7), (4, 12, 2, 10), (16, 8, 14, 6)]).T
SHEET, BACKGROUND = 255 * np.array([0.95, 0.75, 0.35]), 255 * np.array([0.05, 0.05, 0.06])


@pytest.mark.feature("materials/ordered-dither-alpha")
@pytest.mark.parametrize("threshold", TABLE)
def test_survivors_of_a_tile_are_those_of_the_table(stage, threshold):
    y, x = (axis.ravel().astype(np.int32) for axis in np.mgrid[4:8, 8:12])
    pixel = np.tile(np.stack([x, y], axis=-1), (len(ALPHAS), 1))
    inputs = {
        "alpha": np.repeat(np.float32(ALPHAS), 16),
        "threshold": np.full(16 * len(ALPHAS), threshold, np.float32),
        "pixel": pixel,
    }
    body = "drawn = survives(alpha, threshold, pixel) ? 1 : 0; low = dithered_alpha(alpha, pixel);"
    got = stage.evaluate("dithered_alpha/dither.glsl", body, inputs, {"drawn": "int", "low": "float"})
    assert tuple(got["drawn"].reshape(-1, 16).sum(axis=1)) == TABLE[threshold]
    expected = (np.array(ALPHAS)[:, None] - 0.5 * TILE.ravel() / 17).clip(0, 1)
    assert np.abs(got["low"].reshape(-1, 16) - expected).max() < 1e-6
    turned = (np.array(ALPHAS)[:, None] - 0.5 * TILE.T.ravel() / 17).clip(0, 1)
    assert np.abs(got["low"].reshape(-1, 16) - turned).max() > 0.5 / 17, (
        "the table with x and y exchanged is noticed"
    )


@pytest.mark.feature("materials/ordered-dither-alpha")
@pytest.mark.parametrize(("threshold", "alpha"), [(0.5, 0.6), (0.75, 1.0), (0.54, 0.6)])
def test_the_picture_repeats_the_tile(stage, threshold, alpha):
    settings = Settings(threshold=threshold, alpha=alpha)
    picture = stage.draw("dithered-alpha", (16, 12), settings=settings)["color"]
    drawn = np.tile(alpha - 0.5 * TILE / 17 >= threshold, (3, 4))
    assert drawn[:4, :4].sum() == TABLE[threshold][ALPHAS.index(alpha)]
    assert (
        np.abs(picture - np.where(drawn[..., None], SHEET, BACKGROUND)).max()
        <= codes_off(stage.device) + 0.01
    )


def test_without_dither_there_is_an_edge_and_without_a_threshold_a_sheet(stage):
    hard = stage.draw("dithered-alpha", (32, 8), settings=Settings(dither=False))["color"][..., 0] > 128
    assert (hard == (np.arange(32) >= 16)).all()
    whole = stage.draw("dithered-alpha", (32, 8), settings=Settings(threshold=0.0))["color"][..., 0] > 128
    assert whole.all()
