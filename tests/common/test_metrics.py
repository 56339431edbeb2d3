"""Metrics against closed forms, and what they refuse."""

from __future__ import annotations

import math
import sys

import numpy as np
import pytest

from common.errors import UserError
from common.reports.metrics import (
    NonFiniteError,
    check_finite,
    error_map,
    finite_report,
    flip_map,
    flip_mean,
    gradient_step,
    max_abs,
    relative_mse,
)

RNG = np.random.default_rng(5)
PICTURE = RNG.uniform(0.1, 5.0, (24, 32, 3)).astype(np.float32)


def grey(value: float, dtype: type = np.float32) -> np.ndarray:
    return np.full((12, 16, 3), value, dtype)


def test_relative_mse_of_a_constant_factor():
    # For reference 1 everywhere: (f - 1)^2 / (1 + 0.01).
    assert relative_mse(grey(1.25), grey(1.0)) == pytest.approx(0.0625 / 1.01, rel=1e-12)
    assert relative_mse(PICTURE, PICTURE) == 0.0


def test_relative_mse_of_one_wrong_pixel():
    image = grey(0.0)
    image[0, 0] = 3.0
    reference = grey(0.0)
    reference[0] = 1.0  # a twelfth of the picture, so the mean is 1/12
    floor = 0.01 / 144
    expected = (3 * 4.0 / (1 + floor) + 3 * 15 * 1.0 / (1 + floor)) / image.size
    assert relative_mse(image, reference) == pytest.approx(expected, rel=1e-12)


def test_relative_mse_does_not_see_exposure():
    other = PICTURE * RNG.uniform(0.9, 1.1, PICTURE.shape).astype(np.float32)
    for exposure in (2.0**-20, 2.0**12):
        scaled = relative_mse(other * np.float32(exposure), PICTURE * np.float32(exposure))
        assert scaled == pytest.approx(relative_mse(other, PICTURE), rel=1e-12)


def test_relative_mse_against_black():
    assert relative_mse(grey(0.0), grey(0.0)) == 0.0
    assert relative_mse(grey(1e-30), grey(0.0)) == math.inf


def test_max_abs_keeps_the_unit():
    a, b = grey(200, np.uint8), grey(200, np.uint8)
    b[3, 4, 1] = 203  # a - b wraps round in uint8
    assert max_abs(a, b) == max_abs(b, a) == 3.0
    assert max_abs(grey(1.0), grey(-0.5)) == 1.5


@pytest.mark.parametrize("metric", [relative_mse, max_abs, flip_mean])
def test_what_cannot_be_compared(metric):
    with pytest.raises(ValueError, match="different shapes"):
        metric(grey(1.0), grey(1.0)[:-1])
    with pytest.raises(ValueError, match="different units"):
        metric(grey(1, np.uint8), grey(1.0))
    with pytest.raises(ValueError, match="without pixels"):
        metric(grey(1.0)[:0], grey(1.0)[:0])
    for bad in (np.nan, np.inf):
        image = grey(1.0)
        image[1, 2, 0] = bad
        with pytest.raises(NonFiniteError, match="the picture is not finite"):
            metric(image, grey(1.0))
        with pytest.raises(NonFiniteError, match="the reference is not finite"):
            metric(grey(1.0), image)


def test_finite_report_counts_and_finds_the_first():
    image = np.zeros((4, 5, 3), np.float32)
    assert finite_report(image).ok
    check_finite(image)
    check_finite(image.astype(np.uint8))
    image[2, 3] = (np.nan, np.inf, 1.0)
    image[2, 1, 2] = -np.inf
    image[3, 0] = np.nan
    report = finite_report(image)
    assert (report.nan, report.positive_infinity, report.negative_infinity) == (4, 1, 1)
    assert (report.pixels, report.first, report.ok) == (3, (2, 1, 2), False)
    with pytest.raises(
        NonFiniteError,
        match=r"^depth is not finite: 4 NaN, 1 \+Inf, 1 -Inf in 3 .* row 2, column 1, channel 2",
    ):
        check_finite(image, "depth")
    assert finite_report(image[..., 0]).pixels == 2


# --- FLIP ---


def flip_of_greys(a: float, b: float) -> float:
    """FLIP of two uniform grey pictures in closed form (Andersson et al. 2020, sections 4.1.2 to 4.1.4).

    No edges and no colour: what is left is the difference of L*, raised to 0.7, against the largest one, which is
    between green and blue, and the two linear pieces that meet at (0.4, 0.95).
    """

    def lab(rgb: tuple[float, float, float]) -> np.ndarray:
        """Hunt-adjusted L*a*b* of linear sRGB, white point = its own white."""
        to_xyz = np.array(
            [
                (10135552 / 24577794, 8788810 / 24577794, 4435075 / 24577794),
                (2613072 / 12288897, 8788810 / 12288897, 887015 / 12288897),
                (1425312 / 73733382, 8788810 / 73733382, 70074185 / 73733382),
            ]
        )
        ratio = to_xyz @ rgb / to_xyz.sum(axis=1)
        delta = 6 / 29
        f = np.where(ratio > delta**3, np.cbrt(ratio), ratio / (3 * delta**2) + 4 / 29)
        lightness = 116 * f[1] - 16
        return np.array(
            [lightness, 0.01 * lightness * 500 * (f[0] - f[1]), 0.01 * lightness * 200 * (f[1] - f[2])]
        )

    def hyab(x: np.ndarray, y: np.ndarray) -> float:
        return abs(x[0] - y[0]) + math.hypot(*(x - y)[1:])

    def linear(coded: float) -> float:
        return coded / 12.92 if coded <= 0.04045 else ((coded + 0.055) / 1.055) ** 2.4

    largest = hyab(lab((0, 1, 0)), lab((0, 0, 1))) ** 0.7
    difference = hyab(lab((linear(a),) * 3), lab((linear(b),) * 3)) ** 0.7
    knee = 0.4 * largest
    if difference < knee:
        return 0.95 * difference / knee
    return 0.95 + 0.05 * (difference - knee) / (largest - knee)


@pytest.mark.needs("flip_evaluator")
@pytest.mark.parametrize(("a", "b"), [(0.0, 1.0), (0.5, 0.6), (0.02, 0.01), (0.9, 0.2)])
def test_flip_of_uniform_greys(a, b):
    assert flip_mean(grey(a), grey(b)) == pytest.approx(flip_of_greys(a, b), abs=2e-4)


@pytest.mark.needs("flip_evaluator")
def test_flip_scales_integers_and_ignores_alpha():
    eight = RNG.integers(0, 256, (20, 20, 4)).astype(np.uint8)
    other = eight // 2
    floats = flip_map(other[..., :3] / np.float32(255), eight[..., :3] / np.float32(255))
    assert floats.shape == (20, 20)
    np.testing.assert_allclose(flip_map(other, eight), floats, atol=1e-5)
    sixteen = flip_map(other.astype(np.uint16) * 257, eight.astype(np.uint16) * 257)
    np.testing.assert_allclose(sixteen, floats, atol=1e-5)
    one = flip_map(other[..., 0], eight[..., 0])
    np.testing.assert_allclose(one, flip_map(*(np.repeat(p[..., :1], 3, axis=2) for p in (other, eight))))


@pytest.mark.needs("flip_evaluator")
def test_flip_sees_less_of_a_fine_pattern_when_pixels_are_small():
    checker = (np.indices((48, 48)).sum(axis=0) % 2).astype(np.float32)
    half = np.full_like(checker, 0.735)  # the coded value of the mean light
    assert flip_mean(half, checker, pixels_per_degree=200) < 0.5 * flip_mean(
        half, checker, pixels_per_degree=20
    )


@pytest.mark.needs("flip_evaluator")
def test_hdr_flip_is_the_packages_own_where_nothing_is_black():
    import flip_evaluator

    other = PICTURE * np.float32(0.8)
    own = flip_evaluator.evaluate(PICTURE, other, "HDR", applyMagma=False)[1]
    assert flip_mean(other, PICTURE, "hdr") == pytest.approx(own, abs=1e-5)
    assert own > 0.1


@pytest.mark.needs("flip_evaluator")
def test_ldr_flip_clamps_to_what_a_screen_shows():
    assert flip_mean(grey(1.5), grey(1.0)) == flip_mean(grey(-0.5), grey(0.0)) == 0.0
    assert flip_mean(grey(1.5), grey(0.5)) == flip_mean(grey(1.0), grey(0.5))


@pytest.mark.needs("flip_evaluator")
def test_hdr_flip_of_black_pictures(monkeypatch):
    import flip_evaluator

    package, exposures = flip_evaluator.evaluate, []
    monkeypatch.setattr(
        flip_evaluator,
        "evaluate",
        lambda *args, **more: exposures.append(more["parameters"]["numExposures"]) or package(*args, **more),
    )
    # The package ends the process for the first, and takes 26 exposures for the last.
    assert flip_mean(grey(0.0), grey(0.0), "hdr") == 0.0
    assert flip_mean(grey(1.0), grey(0.0), "hdr") > 0.9
    mostly_black = grey(0.0)
    mostly_black[:2] = 5.0
    bright = grey(5.0)
    in_light = flip_map(mostly_black * np.float32(0.9), mostly_black, "hdr")[0, 0]
    assert in_light == pytest.approx(flip_map(bright * np.float32(0.9), bright, "hdr")[0, 0], abs=0.05)
    assert exposures == [2, 2, 2, 2]


@pytest.mark.needs("flip_evaluator")
def test_hdr_flip_does_not_see_exposure():
    other = PICTURE * np.float32(0.8)
    scaled = flip_mean(other * np.float32(2**-10), PICTURE * np.float32(2**-10), "hdr")
    assert scaled == pytest.approx(flip_mean(other, PICTURE, "hdr"), abs=1e-4)


def test_flip_refuses():
    with pytest.raises(ValueError, match="linear floats"):
        flip_mean(grey(1, np.uint8), grey(1, np.uint8), "hdr")
    with pytest.raises(ValueError, match="pixels_per_degree"):
        flip_mean(grey(1.0), grey(1.0), pixels_per_degree=0.0)
    with pytest.raises(ValueError, match=r"\(12, 16, 2\)"):
        flip_mean(grey(1.0)[..., :2], grey(1.0)[..., :2])


def test_flip_without_its_package(monkeypatch):
    monkeypatch.setitem(sys.modules, "flip_evaluator", None)
    with pytest.raises(UserError, match="pip install flip-evaluator"):
        flip_mean(grey(1.0), grey(1.0))


# --- banding ---


def banded(width: int, step: float, count: int = 12) -> np.ndarray:
    """A ramp of `count` bands of `width` pixels, each `step` above the last."""
    row = np.repeat(np.arange(count) * step, width)
    return np.tile(row[None, :, None], (64, 1, 3)).astype(np.float32)


@pytest.mark.parametrize(("width", "step"), [(11, 1 / 64), (33, 1 / 16), (3, 0.5)])
def test_gradient_step_of_bands(width, step):
    ramp = banded(width, step)
    assert gradient_step(ramp) == pytest.approx(step * (1 - 1 / width), rel=1e-6)
    assert gradient_step(ramp.transpose(1, 0, 2), axis=0) == pytest.approx(gradient_step(ramp), rel=1e-12)
    assert gradient_step(ramp[0, :, 0], axis=0) == pytest.approx(gradient_step(ramp), rel=1e-6)


def test_gradient_step_of_a_line_is_nothing():
    line = np.tile(np.linspace(0.0, 1.0, 100)[None, :, None], (4, 1, 3))
    assert gradient_step(line) < 1e-15
    # The mean slope round the middle of a parabola is its slope there: curvature is no step.
    assert gradient_step(line**2) < 1e-15


@pytest.mark.feature("metrics/banding")
def test_gradient_step_falls_with_jitter_and_averaging():
    """Fog in coarse slices: bands without jitter; with a jitter per pixel and a mean over frames they go."""
    depth = np.tile(np.linspace(0.0, 1.0, 256), (32, 1))
    fog, slices, rng = lambda z: 1.0 - np.exp(-1.5 * z), 16, np.random.default_rng(1)
    off = fog(np.floor(depth * slices) / slices)
    jitter = rng.random((32, *depth.shape))
    on = fog(np.floor(depth * slices + jitter) / slices).mean(axis=0)
    assert gradient_step(off) > 0.01
    assert gradient_step(on) < 0.2 * gradient_step(off)


@pytest.mark.feature("metrics/banding")
def test_gradient_step_refuses():
    with pytest.raises(ValueError, match="no window of 33 steps"):
        gradient_step(np.zeros((4, 33, 3)))
    with pytest.raises(NonFiniteError):
        gradient_step(np.full((4, 40, 3), np.nan))


# --- error map ---


def test_error_map_colors():
    reference = np.zeros((2, 3, 3), np.float32)
    image = reference.copy()
    image[0, 1, 2], image[0, 2, 0], image[1, 0, 1] = 0.5, -1.0, np.nan
    picture = error_map(image, reference)
    assert picture.shape == (2, 3, 3) and picture.dtype == np.uint8
    assert picture[0, 0].tolist() == picture[1, 2].tolist() == [0, 0, 4]
    assert picture[0, 1].tolist() == [183, 55, 121]
    assert picture[0, 2].tolist() == [252, 253, 191]
    assert picture[1, 0].tolist() == [0, 255, 0]
    assert error_map(image, reference, limit=0.25)[0, 1].tolist() == [252, 253, 191]
    assert (error_map(reference, reference) == (0, 0, 4)).all()


def test_error_map_grows_lighter():
    size = np.linspace(0.0, 1.0, 200)[None, :, None]
    picture = error_map(size, np.zeros_like(size))
    luminance = picture[0] @ (0.2126, 0.7152, 0.0722)
    assert (np.diff(luminance) > -1.0).all() and luminance[-1] > 240
    assert error_map(np.full((2, 2, 3), 250, np.uint8), np.full((2, 2, 3), 252, np.uint8)).max() == 253
