"""Errors of sequences against closed forms: constant and alternating errors, sharpness of ideal and blurred edges."""

from __future__ import annotations

import math
import sys
from math import erf

import numpy as np
import pytest

from common.reports.metrics import NonFiniteError
from common.reports.sequences import (
    OverTime,
    error_over_time,
    flicker,
    flicker_over_time,
    ghost,
    mtf50,
    psnr,
)

RNG = np.random.default_rng(11)
PICTURE = RNG.integers(20, 200, (12, 16, 3)).astype(np.uint8)


def test_psnr_of_a_constant_difference():
    assert psnr(PICTURE + np.uint8(5), PICTURE) == pytest.approx(20 * math.log10(255 / 5), rel=1e-14)
    assert psnr(PICTURE, PICTURE) == math.inf
    black, white = np.zeros((4, 4), np.uint8), np.full((4, 4), 255, np.uint8)
    assert psnr(white, black) == 0.0
    # One pixel of 16 off by 8: the mean squared difference is 4.
    one = black.copy()
    one[1, 2] = 8
    assert psnr(one, black) == pytest.approx(20 * math.log10(255 / 2), rel=1e-14)


def test_codes_of_all_kinds_of_numbers_are_on_one_scale():
    other = PICTURE + np.uint8(3)
    expected = psnr(other, PICTURE)
    assert psnr(other / 255.0, PICTURE / 255.0) == pytest.approx(expected, rel=1e-12)
    deep = [picture.astype(np.uint16) * 257 for picture in (other, PICTURE)]
    assert psnr(*deep) == pytest.approx(expected, rel=1e-12)
    assert flicker([PICTURE, other], [PICTURE, PICTURE]) == 3.0
    assert flicker([PICTURE / 255.0, other / 255.0], [PICTURE / 255.0] * 2) == pytest.approx(3.0, rel=1e-12)


def test_an_error_that_stays_does_not_flicker_and_one_that_alternates_does_by_twice_its_size():
    moving = [np.roll(PICTURE, step, axis=1) for step in range(5)]
    assert flicker(moving, moving) == 0.0
    assert flicker([frame + np.uint8(7) for frame in moving], moving) == 0.0
    signs = (1, -1, 1, -1, 1)
    turning = [
        (frame.astype(int) + 4 * sign).astype(np.uint8) for frame, sign in zip(moving, signs, strict=True)
    ]
    assert list(flicker_over_time(turning, moving)) == [8.0] * 4
    # A frozen picture flickers by as much as the reference moves.
    still = [moving[0], moving[0]]
    expected = np.abs(moving[1].astype(int) - moving[0]).mean()
    assert flicker(still, moving[:2]) == pytest.approx(expected, rel=1e-14)


def test_one_pixel_that_blinks_counts_by_its_part_of_the_picture():
    dark = np.zeros((8, 8), np.uint8)
    lit = dark.copy()
    lit[3, 3] = 64
    assert flicker([dark, lit, dark, lit], [dark] * 4) == 1.0
    with pytest.raises(ValueError, match="two at least"):
        flicker([dark], [dark])


def test_errors_over_time_are_those_of_each_frame():
    frames = [(PICTURE + step).astype(np.uint8) for step in (0, 2, 6)]
    found = list(error_over_time(frames, [PICTURE] * 3, flip=False))
    assert [one.frame for one in found] == [0, 1, 2]
    assert [one.max_abs for one in found] == [0.0, 2.0, 6.0]
    assert found[0].psnr == math.inf and found[2].psnr == pytest.approx(20 * math.log10(255 / 6))
    assert [one.flip for one in found] == [None] * 3
    codes = PICTURE.astype(np.float64)
    floor = 0.01 * codes.mean() ** 2
    assert found[1].relative_mse == pytest.approx((4 / (codes**2 + floor)).mean(), rel=1e-12)
    with pytest.raises(ValueError, match="shorter"):
        list(error_over_time(frames, [PICTURE] * 2, flip=False))


def test_what_is_gathered_has_the_worst_frame_and_means():
    over = OverTime(flip=False)
    for step in (0, 4, 1):
        over.add((PICTURE + step).astype(np.uint8), PICTURE)
    assert over.worst().frame == 1
    assert over.flicker == [4.0, 3.0]
    mean = over.mean()
    assert mean["max_abs"] == pytest.approx(5 / 3) and mean["flicker"] == 3.5 and mean["flip"] is None
    # The mean squared difference is 17 / 3, although the first frame's PSNR is infinite.
    assert mean["psnr"] == pytest.approx(10 * math.log10(255**2 / (17 / 3)), rel=1e-12)
    same = OverTime(flip=False)
    same.add(PICTURE, PICTURE)
    assert same.mean()["psnr"] == math.inf and same.mean()["flicker"] is None


def test_light_is_what_the_relative_error_is_of():
    light = RNG.uniform(0.5, 4.0, (12, 16, 3)).astype(np.float32)
    over = OverTime(flip=False)
    found = over.add(PICTURE, PICTURE, (light * np.float32(2), light))
    values = light.astype(np.float64)
    expected = (values**2 / (values**2 + 0.01 * values.mean() ** 2)).mean()
    assert found.relative_mse == pytest.approx(expected, rel=1e-6) and found.max_abs == 0.0


@pytest.mark.needs("flip_evaluator")
def test_flip_is_there_with_its_package(monkeypatch):
    white, black = (np.full((8, 8, 3), code, np.uint8) for code in (255, 0))
    (found,) = error_over_time([white], [black])
    assert found.flip == pytest.approx(0.967, abs=1e-3)
    monkeypatch.setitem(sys.modules, "flip_evaluator", None)
    (found,) = error_over_time([white], [black])
    assert found.flip is None


def test_ghosts_are_largest_and_mean_differences():
    absent = np.full((10, 10, 3), 100, np.uint8)
    frame = absent.copy()
    frame[2, 3] = (110, 100, 95)
    found = ghost(frame, absent)
    assert (found.most, found.mean) == (10.0, 15 / 300)
    where = np.zeros((10, 10), bool)
    where[2, 2:4] = True
    assert ghost(frame, absent, where).mean == 15 / 6
    with pytest.raises(ValueError, match="no pixel"):
        ghost(frame, absent, np.zeros((10, 10), bool))


# --- sharpness --------------------------------------------------------------------------------------------------------


def distances(angle: float, finer: int = 1, size: tuple[int, int] = (64, 48)) -> np.ndarray:
    """The distances of all samples from an edge through the middle, 0.13 pixels to the left of it."""
    height, width = size
    y = (np.arange(height * finer) + 0.5) / finer - height / 2
    x = (np.arange(width * finer) + 0.5) / finer - width / 2 + 0.13
    return (x[None] - y[:, None] * math.tan(angle)) * math.cos(angle)


def averaged(angle: float, finer: int = 16) -> np.ndarray:
    """An ideal edge of which each pixel has the mean over its area."""
    sides = (distances(angle, finer) > 0).astype(np.float64)
    return sides.reshape(64, finer, 48, finer).mean(axis=(1, 3))


def where_half(transfer) -> float:
    """The frequency at which a falling function is 0.5, by bisection."""
    low, high = 0.0, 1.0
    for _ in range(60):
        middle = (low + high) / 2
        low, high = (middle, high) if transfer(middle) > 0.5 else (low, middle)
    return low


@pytest.mark.parametrize("degrees", [3.0, 5.0, -5.0, 8.0, 10.0])
def test_an_edge_averaged_over_pixels_has_the_sharpness_of_a_box(degrees):
    angle = math.radians(degrees)
    expected = where_half(lambda f: np.sinc(f * math.cos(angle)) * np.sinc(f * math.sin(angle)))
    assert expected == pytest.approx(0.604, abs=0.003)
    assert mtf50(averaged(angle), angle) == pytest.approx(expected, rel=0.002)
    assert mtf50(3 - 2 * averaged(angle), angle) == pytest.approx(expected, rel=0.002)  # dark to the right


@pytest.mark.parametrize("sigma", [0.4, 0.5, 1.0, 2.0, 3.0])
def test_a_gaussian_edge_has_the_sharpness_of_its_closed_form(sigma):
    angle = math.radians(5.0)
    edge = 0.5 * (1 + np.vectorize(erf)(distances(angle) / (sigma * math.sqrt(2))))
    expected = math.sqrt(math.log(2) / 2) / (math.pi * sigma)
    assert mtf50(edge, angle) == pytest.approx(expected, rel=5e-4)


def test_a_hard_edge_keeps_its_contrast_and_a_wider_box_loses_half_of_it():
    angle = math.radians(5.0)
    assert mtf50((distances(angle) > 0).astype(np.float32), angle) == math.inf
    # Two pixels that are averaged across the edge: sinc of twice the frequency, along rows.
    edge = averaged(angle)
    wide = (edge[:, :-1] + edge[:, 1:]) / 2
    expected = where_half(
        lambda f: (
            np.sinc(f * math.cos(angle))
            * np.sinc(f * math.sin(angle))
            * abs(math.cos(math.pi * f * math.cos(angle)))
        )
    )
    assert mtf50(wide, angle) == pytest.approx(expected, rel=0.002)


@pytest.mark.parametrize(
    ("rows", "degrees", "says"),
    [
        (np.ones((64, 48)), 5.0, "no edge"),
        (np.ones((3, 48)), 5.0, "4 pixels at least"),
        (np.ones((64, 48, 3)), 5.0, "4 pixels at least"),
        ((distances(0.0) > 0).astype(float), 0.0, "too few fractions"),
        ((distances(1.0) > 0).astype(float), 60.0, "leaves the picture"),
    ],
)
def test_what_has_no_sharpness_is_refused(rows, degrees, says):
    with pytest.raises(ValueError, match=says):
        mtf50(rows, math.radians(degrees))


def test_what_is_not_finite_or_not_alike_is_refused():
    light = PICTURE / 255.0
    broken = light.copy()
    broken[3, 4, 1] = np.nan
    for call in (
        lambda: psnr(broken, light),
        lambda: ghost(light, broken),
        lambda: flicker([light, broken], [light, light]),
        lambda: mtf50(np.where(np.arange(48) > 20, np.nan, np.ones((64, 48))), 0.1),
    ):
        with pytest.raises(NonFiniteError):
            call()
    with pytest.raises(ValueError, match="different shapes"):
        psnr(PICTURE[1:], PICTURE)
    with pytest.raises(ValueError, match="different units"):
        psnr(light, PICTURE)
    with pytest.raises(ValueError, match="without pixels"):
        psnr(PICTURE[:0], PICTURE[:0])
    with pytest.raises(ValueError, match="different shapes"):
        flicker([PICTURE, PICTURE[1:]], [PICTURE, PICTURE[1:]])
