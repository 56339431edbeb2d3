"""The study flipbook: exact pictures at exact times, none before the first or after the last, in one draw."""

from __future__ import annotations

import math
from fractions import Fraction

import numpy as np
import pytest

import chapters
from chapters import studies
from chapters.ch02.studies.flipbook import (
    CAPACITY,
    EVERY,
    FRAMES,
    SIDE,
    Explosion,
    Settings,
    explosions,
    frame_at,
    pictures,
)

SIZE = (60, 40)
BACKGROUND = np.rint(255 * np.array([0.05, 0.05, 0.06])).astype(int)
FPS = 64.0  # times below are multiples of 1/64 s: no product is rounded, and each boundary can be met


def book() -> np.ndarray:
    """Pictures of one colour each, which tells its number."""
    made = np.full((FRAMES, 2, 2, 4), 255, np.uint8)
    number = np.arange(FRAMES)
    made[..., 0], made[..., 1] = (2 * number)[:, None, None], (255 - number)[:, None, None]
    return made


def drawn(stage, monkeypatch, burning, time, fps=FPS, pictures=book):
    module = chapters.renderer_module("2/flipbook", stage.backend)
    monkeypatch.setattr(module.Renderer, "pictures", staticmethod(pictures))
    monkeypatch.setattr(module.Renderer, "explosions", staticmethod(lambda settings, size, time: burning))
    with stage.open("2/flipbook", SIZE, settings=Settings(fps=fps)) as renderer:
        frame = renderer.render(chapters.view_of(renderer), time)
        return frame.image("color").astype(int), frame.work


def expected(burning, time, fps=FPS):
    """The picture in numpy, by times as fractions; sides are even and middles on whole pixels."""
    made = np.tile(BACKGROUND, (SIZE[1], SIZE[0], 1))
    for one in burning:
        number = (Fraction(time) - Fraction(one.start)) * Fraction(fps)
        if 0 <= number < 100:
            x, y, half = round(one.x * SIZE[0]), round(one.y * SIZE[1]), int(one.side) // 2
            rows, columns = slice(max(0, y - half), y + half), slice(max(0, x - half), x + half)
            made[rows, columns] = 2 * int(number), 255 - int(number), 255
    return made


BURNING = [
    Explosion(0.0, 0.25, 0.5, 20.0),
    Explosion(1.0, 0.5, 0.5, 20.0),  # over the first one
    Explosion(1.5, 0.95, 0.25, 8.0),  # over the edge of the picture
]


@pytest.mark.feature("bindless/flipbook")
@pytest.mark.parametrize(
    "time",
    [
        0.0,
        1 / 64,
        1.5 / 64,
        63 / 64,
        1.0,
        1.5,
        99 / 64,
        99.5 / 64,
        100 / 64,
        163 / 64,
        164 / 64,
        195.5 / 64,
        196 / 64,
    ],
)
def test_each_shows_its_own_picture_and_is_gone_at_the_hundredth(stage, monkeypatch, time):
    picture, work = drawn(stage, monkeypatch, BURNING, time)
    assert (picture == expected(BURNING, time)).all()
    alive = sum(0 <= 64 * (time - one.start) < 100 for one in BURNING)
    assert work["draws"] == int(alive > 0) and work["triangles"] == 2 * alive


@pytest.mark.feature("bindless/flipbook")
def test_one_that_goes_out_leaves_the_others_in_their_order(stage, monkeypatch):
    """Had the last one taken its place, the second would lie on top of the third."""
    burning = [Explosion(0.0, 0.5, 0.5, 8.0), Explosion(1.0, 0.5, 0.5, 24.0), Explosion(1.25, 0.5, 0.5, 16.0)]
    for time in (99.5 / 64, 100 / 64):
        picture, _ = drawn(stage, monkeypatch, burning, time)
        assert (picture == expected(burning, time)).all()
        assert picture[20, 30, 0] == 2 * int(64 * (time - 1.25))


@pytest.mark.feature("bindless/flipbook")
def test_the_number_is_the_floor_of_time_by_rate_from_0_to_99():
    rng = np.random.default_rng(7)
    for start, fps, time in rng.uniform((0, 10, 0), (3, 200, 12), (2000, 3)):
        exact = (Fraction(time) - Fraction(start)) * Fraction(fps)
        if abs(exact - round(exact)) > 1e-9:  # nearer to a boundary, rounding may decide
            assert frame_at(start, fps, time) == (math.floor(exact) if 0 <= exact < 100 else None)
    assert [frame_at(1.0, 50.0, 1.0 + n / 50 + 0.001) for n in (-1, 0, 99, 100)] == [None, 0, 99, None]


def test_a_burst_has_a_sharp_rim_that_grows_and_nothing_beyond_it():
    """The edge goes from covered to clear in 1/8 of half a picture, which are four texels; corners are always clear."""
    alpha = pictures()[..., 3].astype(int)
    assert (alpha[:, [0, 0, -1, -1], [0, -1, 0, -1]] == 0).all()
    covered = (alpha > 0).sum(axis=(1, 2))
    assert (np.diff(covered[:20]) >= 0).all() and covered[20] > 4 * covered[0]
    for number in (15, 30, 45):  # before the picture fades out
        row = alpha[number, SIDE // 2]
        assert row.max() == 255 and 2 <= ((row > 0) & (row < 255)).sum() <= 4 * 6


@pytest.mark.parametrize("fps", [10.0, 50.0, 1000.0])
def test_none_that_still_burns_is_left_out_and_all_fit(fps):
    settings = Settings(fps=fps)
    for time in (0.0, 0.349, 0.35, 5.0, 100.0, 1e5):
        shown = explosions(settings, SIZE, time)
        alive = [one.start for one in shown if frame_at(one.start, fps, time) is not None]
        newest = math.floor(time / EVERY)
        every = [n * EVERY for n in range(max(0, newest - 60), newest + 1)]
        assert alive == [start for start in every if frame_at(start, fps, time) is not None]
        assert len(shown) <= CAPACITY and shown == sorted(shown, key=lambda one: one.start)


@pytest.mark.feature("bindless/flipbook")
def test_what_is_shown_by_itself_moves_and_is_the_same_for_the_same_time(stage):
    assert studies.study("2/flipbook").scene is None
    first, again, later = (stage.draw("2/flipbook", SIZE, time)["color"] for time in (1.3, 1.3, 1.4))
    assert (first == again).all() and (first != later).mean() > 0.02
