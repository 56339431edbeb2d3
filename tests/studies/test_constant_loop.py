"""The study constant-loop: both loops against weighted means in float64, and a pipeline for each constant."""

from __future__ import annotations

import numpy as np
import pytest

import chapters
from chapters.ch09.studies.constant_loop import Settings, noise

pytestmark = pytest.mark.feature("specialization/pipeline-constants")
WHICH, ELEMENTS = "9/constant-loop", 300
TAPS = 2 ** np.arange(11)


def test_both_loops_are_the_weighted_mean_within_rounding_and_the_picture_shows_it(stage):
    """Each term and each sum has a rounding of 2^-24, and a division may be 2.5 units in the last place off."""
    settings = Settings(elements=ELEMENTS)
    row = noise(settings).astype(np.float64)
    assert 0.4 < row.mean() < 0.6 and row.std() > 0.25
    with stage.open(WHICH, (44, 30), settings=settings) as renderer:
        frame = renderer.render(chapters.view_of(renderer))
        picture, found, work = frame.image("color"), renderer.results(), frame.work
        timings = frame.timings
        handles = {kernel.handle for kernel in renderer.kernels}
    assert found.shape == (11, 2, ELEMENTS)
    for column, taps in enumerate(TAPS):
        t = (np.arange(taps) + 0.5) / taps
        weights = t * (1 - t) / (t * (1 - t)).sum()
        truth = np.convolve(row, weights[::-1], "valid")[:ELEMENTS]
        assert np.abs(found[column] - truth).max() <= (taps + 12) * 2.0**-23, taps
        shown = picture[:, 4 * column : 4 * column + 4]
        # 30 rows of the picture are the first 30 elements; each half of a column is 2 pixels wide.
        assert np.abs(shown - 255 * truth[:30, None, None]).max() <= 1, taps
    assert len(handles) == len(TAPS) + 1, "one for each constant, and one for all numbers that are pushed"
    assert (work["dispatches"], work["draws"]) == (2 * len(TAPS), 1)
    assert timings.keys() >= {f"{way} {taps}" for way in ("pushed", "constant") for taps in TAPS}
