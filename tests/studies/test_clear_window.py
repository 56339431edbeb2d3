"""The study clear-window against its closed form."""

from __future__ import annotations

import math

import numpy as np
import pytest

import chapters
from chapters.ch01.studies.clear_window import PERIOD_S
from tests.support.bounds import codes_off


def codes_at(time: float) -> list[float]:
    """Return the display codes, unrounded: a raised cosine whose three copies are a third of a period apart."""
    return [255 * math.cos(math.pi * (time / 6.0 - third / 3)) ** 2 for third in range(3)]


@pytest.mark.parametrize("time", [0.0, 0.7, 2.0, 4.0, 5.9, 1e4])
def test_every_pixel_has_the_colour_of_the_time(stage, time):
    picture = stage.draw("clear-window", (19, 7), time)["color"]
    assert picture.shape == (7, 19, 3)
    # Rounding, and a hair for the driver's conversion.
    assert np.abs(picture - np.array(codes_at(time))).max() <= codes_off(stage.device) + 1e-3
    assert (picture == picture[0, 0]).all()


def test_at_zero_red_is_full_and_the_others_are_a_quarter(stage):
    assert stage.draw("clear-window", (1, 1))["color"].tolist() == [[[255, 64, 64]]]


def test_time_alone_changes_the_picture_and_a_period_brings_it_back(stage):
    with stage.open("clear-window", (4, 4)) as renderer:
        view = chapters.view_of(renderer)
        pictures = [
            renderer.render(view, time).image("color") for time in (0.5, 1.0, 0.5, 0.5 + PERIOD_S, 1.0)
        ]
        assert renderer.idle(view, 1.0) and not renderer.idle(view, 1.5)
    first, other, again, later, last = pictures
    assert (first == again).all() and (first == later).all() and (other == last).all()
    assert (first != other).any()
