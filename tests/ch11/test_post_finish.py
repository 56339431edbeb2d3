"""Sharpening, exposure and gamma of the display, split views and dither, as frames show them."""

from __future__ import annotations

import numpy as np
import pytest

from chapters.ch11.settings import Settings
from common.images.color import encode_srgb
from common.settings import replaced
from tests.support.bounds import codes_off
from tests.support.glowing import glowing
from tests.support.scenes import facing
from tests.twins import finish as twin
from tests.twins.hdr import luminance, tone_aces, tone_reinhard
from tests.twins.shading import tone_neutral

pytestmark = pytest.mark.variants("vulkan", "gl")

EV = -0.2630344058337938
"""The EV100 of exposure 1: nits are picture values."""

PLAIN = Settings(ambient=0.0, default_light=False, color_format="rgba32f", msaa=1)
FINISHED = {
    "sharpen": 1.0,
    "fxaa": True,
    "dither": 1.0,
    "display_gamma": 1.3,
    "display_exposure": 0.7,
    "tone_curve": "reinhard",
}


def shown(chapter, picture, outputs=("color",), frames=1, **knobs):
    """Return outputs of a rectangle that shows an image of nits, and the names of the passes."""
    size = picture.shape[1::-1]
    settings = replaced(PLAIN, **knobs)
    with chapter.open(glowing(picture), size, settings, outputs=set(outputs)) as opened:
        for _ in range(frames):
            frame = opened.render(facing(ev100=EV))
        return *(frame.image(name) for name in outputs), [step.name for step in opened.graph.steps]


def values(shape, seed=2):
    rng = np.random.default_rng(seed)
    return np.float32(10.0 ** rng.uniform(-2, 1, (*shape, 1)) * rng.uniform(0.2, 1.0, (*shape, 3)))


# --- sharpening ---


@pytest.mark.core
@pytest.mark.feature("taa/sharpening")
def test_sharpened_light_is_that_of_its_definition_and_black_stays_black(chapter):
    """Against float64; beside a lamp of half precision's limit nothing is black, and black is."""
    picture = values((24, 30))
    picture[3:6, 3:6] = 0.0
    picture[10, 10] = 65504.0
    (plain, _), (found, steps) = (
        shown(chapter, picture, ["color_linear"], sharpen=amount) for amount in (0.0, 1.0)
    )
    wanted = np.minimum(twin.sharpened(plain, 1.0), 65504.0)
    np.testing.assert_allclose(found, wanted, rtol=1e-5)
    assert "sharpen" in steps and np.isfinite(found).all()
    assert not found[3:6, 3:6].any() and found[9:12, 9:12].min() > 0.0
    ratio = luminance(found[9:12, 9:12]) / luminance(plain[9:12, 9:12])
    assert ratio.min() == pytest.approx(0.5, rel=1e-5)
    assert found.std() > 1.2 * plain[plain < 65504].std()


@pytest.mark.feature("taa/sharpening")
def test_an_amount_of_0_has_no_pass_and_constants_stay_to_the_bit(chapter):
    picture = np.full((12, 16, 3), 0.7, np.float32)
    (off, without), (on, steps) = (
        shown(chapter, picture, ["color"], sharpen=amount) for amount in (0.0, 2.0)
    )
    assert set(steps) - set(without) == {"sharpen"} and np.array_equal(off, on)


# --- display ---

CURVES = {
    "neutral": tone_neutral,
    "reinhard": lambda color: tone_reinhard(color, 1.17),
    "aces": tone_aces,
    "none": lambda color: color,
}


@pytest.mark.feature("postprocess/gamma-exposure-compare", "postprocess/tone-mapping")
@pytest.mark.parametrize("curve", sorted(CURVES))
def test_gamma_and_exposure_around_each_curve(chapter, curve):
    """An exposure and a gamma of 1 give the curve itself; others give curve(exposure c)^(1 / gamma), then the code."""
    picture = np.float32(np.geomspace(1e-3, 50.0, 64)[:, None] * np.array([1.0, 0.6, 0.2])).reshape(8, 8, 3)
    bounds = codes_off(chapter.device) + 0.03
    for exposure, gamma in ((1.0, 1.0), (0.5, 2.2)):
        knobs = {
            "tone_curve": curve,
            "tone_white": 1.17,
            "display_exposure": exposure,
            "display_gamma": gamma,
        }
        found, _ = shown(chapter, picture, **knobs)
        light = np.clip(CURVES[curve](picture.astype(np.float64) * exposure), 0, 1)
        assert np.abs(found - 255 * encode_srgb(light ** (1 / gamma))).max() < bounds, (exposure, gamma)


@pytest.mark.feature("postprocess/tone-mapping")
def test_the_printed_values_of_extended_reinhard_are_shown(chapter):
    """Per channel with white at 1.17: R(0) = 0, R(.5) = .45509, R(1) = .86526, R(1.17) = 1; more is never darker.

    A white point above the picture's light keeps the contrast of what is brighter than 1: no channel saturates.
    """
    light = np.float32([[0.0, 0.5, 1.0, 1.17, 2.0], [0.25, 0.75, 1.0, 1.1, 60.0]])
    found, _ = shown(chapter, light, tone_curve="reinhard", tone_white=1.17)
    wanted = 255 * encode_srgb(np.array([0.0, 0.45509, 0.86526, 1.0, 1.0]))
    assert np.abs(found[0] - wanted[:, None]).max() < codes_off(chapter.device) + 0.02
    assert found[0, 0].max() == 0 and found[0, 3].min() == 255
    assert (np.diff(found.astype(int)[..., 0], axis=1) >= 0).all()
    bright = np.float32([[1.5, 2.0, 3.0, 5.0, 8.0, 12.0, 20.0, 40.0]])
    clipped, _ = shown(chapter, bright, tone_curve="none")
    kept, _ = shown(chapter, bright, tone_curve="reinhard", tone_white=64.0)
    assert (clipped == 255).all()
    assert (np.diff(kept.astype(int)[0, :, 0]) > 0).all() and kept.max() < 255


@pytest.mark.feature("postprocess/gamma-exposure-compare")
@pytest.mark.parametrize(("axis", "at"), [("columns", 0.5), ("rows", 0.3)])
def test_a_split_view_shows_raw_and_finished_parts(chapter, axis, at):
    """The raw part is that of no curve and nothing finished, the other one that of no split, with one boundary."""
    picture = values((20, 30))
    finished, _ = shown(chapter, picture, **FINISHED)
    raw, _ = shown(chapter, picture, tone_curve="none")
    found, _ = shown(chapter, picture, **FINISHED, split=axis, split_at=at)
    boundary = int(np.floor(at * (20 if axis == "rows" else 30) + 0.5))
    first = np.s_[:boundary] if axis == "rows" else np.s_[:, :boundary]
    rest = np.s_[boundary:] if axis == "rows" else np.s_[:, boundary:]
    assert np.array_equal(found[first], raw[first]) and np.array_equal(found[rest], finished[rest])
    assert not np.array_equal(raw[first], finished[first])


@pytest.mark.feature("postprocess/gamma-exposure-compare")
def test_a_split_without_fxaa_and_dither_is_made_by_the_tone_curves_pass(chapter):
    picture = values((10, 12))
    found, steps = shown(chapter, picture, split="rows")
    raw, without = shown(chapter, picture, tone_curve="none")
    plain, _ = shown(chapter, picture)
    assert steps == without
    assert np.array_equal(found[:5], raw[:5]) and np.array_equal(found[5:], plain[5:])


# --- dither ---


def blurred(picture):
    """Return the mean of 7x7 pixels around each, without a rim."""
    windows = np.lib.stride_tricks.sliding_window_view(picture, (7, 7))
    return windows.mean((-2, -1))


@pytest.mark.feature("taa/dithering")
@pytest.mark.parametrize("fxaa", [False, True])
def test_dither_keeps_the_mean_and_removes_the_bands_of_a_slow_ramp(chapter, fxaa):
    """Of 6 codes over 96 columns, after a blur that leaves no pattern, against the ramp itself.

    The noise of a pixel and its rounding have a variance of at most 1/4 square codes. The mean of n pixels of
    independent noise would have sqrt(1 / 4n); four times that is allowed. Before FXAA codes are halves, which a device
    may truncate: between 1/8 and 1/4 of white by less than 2^-13.
    """
    codes = np.broadcast_to(np.linspace(40.0, 46.0, 96), (48, 96))
    light = np.where(codes <= 10.31475, codes / 255 / 12.92, ((codes / 255 + 0.055) / 1.055) ** 2.4)
    knobs = {"tone_curve": "none", "fxaa": fxaa}
    banded, steps = shown(chapter, np.float32(light), **knobs)
    noisy, with_noise = shown(chapter, np.float32(light), **knobs, dither=1.0)
    again, _ = shown(chapter, np.float32(light), frames=2, **knobs, dither=1.0)
    assert steps == with_noise and not np.array_equal(noisy, again)
    banded, noisy = (it[..., 0].astype(np.float64) for it in (banded, noisy))
    truncated = 0.0 if not fxaa or chapter.device.capabilities.is_software else 255 * 2.0**-13
    assert abs(noisy.mean() - codes.mean()) < 4 * np.sqrt(0.25 / codes.size) + truncated
    assert np.abs(noisy - codes).max() < 1.51
    errors = [np.sqrt(((blurred(it) - blurred(codes)) ** 2).mean()) for it in (banded, noisy)]
    assert errors[0] > 0.15 and errors[1] < 0.3 * errors[0], errors


@pytest.mark.feature("taa/dithering")
def test_black_and_white_stay_under_dither(chapter):
    picture = np.zeros((16, 16), np.float32)
    picture[:, 8:] = 2.0
    found, _ = shown(chapter, picture, tone_curve="none", dither=1.0)
    assert (found[:, :8] == 0).all() and (found[:, 8:] == 255).all()
