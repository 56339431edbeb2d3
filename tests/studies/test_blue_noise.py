"""The study blue-noise: numbers, samples and codes to the bit, spectra in float64, and errors of means over frames."""

from __future__ import annotations

import numpy as np
import pytest

import chapters
from chapters.ch10.studies.blue_noise import Settings, frequencies, radial, tables
from common.errors import SettingError
from common.numerics import blue_noise
from common.settings import apply_overrides
from tests.support.bounds import codes_off
from tests.twins.noise import pcg3d

WHICH, SIZE = "10/blue-noise", 128
WHITE, TURNED, BLUE = range(3)
SAMPLE, SAMPLES, CODE, CODES, REMAP, REMAPS = range(6)
VARIANCES = np.array([1 / 6, 1 / 6, 1 / 4, 1 / 4, 1 / 4, 1 / 4])[:, None, None]
NEAR = 2.0**-21
"""How near to a whole number a sum of light and a root may be rounded to the other side."""

blue = pytest.mark.feature("noise/blue-noise")
animated = pytest.mark.feature("noise/temporal-animation")
LIGHT = (np.arange(SIZE) + 0.5) / SIZE
LOW = (frequencies() > 0) & (frequencies() <= 0.1)


def measured(stage, size=(48, 48), **knobs):
    """Return images (3, 9, 128, 128), spectra (3, 6, 128, 128), the picture, and the counters of a frame."""
    with stage.open(WHICH, size, settings=Settings(**knobs)) as renderer:
        frame = renderer.render(chapters.view_of(renderer))
        return renderer.images(), renderer.spectra(), frame.image("color"), frame.work


def numbers(way, frame):
    """Return two numbers of each texel in a frame, (2, 128, 128) float32."""
    y, x = np.mgrid[:SIZE, :SIZE]
    if way == WHITE:
        words = pcg3d(np.stack([x, y, np.full_like(x, frame)], axis=-1))[..., :2]
        return np.moveaxis((words >> np.uint64(8)).astype(np.float64) / 2**24, -1, 0).astype(np.float32)
    ranks = (
        blue_noise.ranks() if way == BLUE else np.stack([tables()[0] & 0xFFFF, tables()[0] >> 16], axis=-1)
    )
    return np.moveaxis(blue_noise.animated(ranks, frame), -1, 0)


def expected(way, frames, first, steps):
    """Return the images (9, 128, 128) of a way, and in how many frames (128, 128) rounding decides about a code.

    Light and all codes are few digits: float64 rounds nowhere.
    """
    found, unclear = np.zeros((9, SIZE, SIZE)), np.zeros((SIZE, SIZE))
    for k in range(frames):
        a, b = numbers(way, first + k)
        noise = blue_noise.triangular(a, b)
        a = a.astype(np.float64)
        from_middle = 2 * a - 1
        one = np.sign(from_middle) * (1 - np.sqrt(1 - np.abs(from_middle)))
        sample, wanted = a < LIGHT, LIGHT * steps + one + 0.5
        # The shader adds one half to the sum in float32; then both terms are multiples of 2^-24 and below 2^8.
        code = np.floor((np.float32(LIGHT * steps) + (noise + np.float32(0.5))).astype(np.float64))
        if k == 0:
            found[[0, 1, 2, 3, 5, 7]] = a, noise, one, sample, code, np.floor(wanted)
        found[[4, 6, 8]] += sample, code, np.floor(wanted)
        unclear += np.abs(wanted - np.round(wanted)) < NEAR
    return found, unclear


def errors(images, frames, steps):
    """Return what the rows of a way (6, 128, 128) are off, in light or in steps."""
    scale = np.array([1, frames, 1, frames, 1, frames])[:, None, None]
    white = np.array([1, 1, steps, steps, steps, steps])[:, None, None]
    return images[3:].astype(np.float64) / scale - LIGHT * white


@blue
@animated
@pytest.mark.parametrize(("frames", "first", "steps"), [(1, 0, 1), (16, 3, 4), (40, 1000003, 7)])
def test_images_are_those_of_numpy_to_the_bit(stage, frames, first, steps):
    images, *_ = measured(stage, frames=frames, first=first, steps=steps)
    for way in range(3):
        truth, unclear = expected(way, frames, first, steps)
        exact = [0, 1, 3, 4, 5, 6]
        assert np.array_equal(images[way, exact], truth[exact].astype(np.float32)), way
        assert np.abs(images[way, 2] - truth[2]).max() <= 4 * 2.0**-23
        assert (np.abs(images[way, 7] - truth[7]) <= (unclear > 0)).all()
        assert (np.abs(images[way, 8] - truth[8]) <= unclear).all() and unclear.mean() < 0.01


@blue
def test_spectra_are_those_of_float64(stage):
    """A sum of 128 products rounds 128 times, a product four times, and a factor once: 133 roundings in each of two
    passes, each of 2^-24 of the sum of all sizes at most. All factors have sizes up to 1."""
    frames, steps = 5, 3
    images, spectra, *_ = measured(stage, frames=frames, steps=steps)
    for way in range(3):
        error = errors(images[way], frames, steps)
        exact = np.fft.fft2(error)
        off = 2 * 133 * 2.0**-24 * np.sqrt(2) * np.abs(error).sum(axis=(1, 2), keepdims=True)
        power = np.abs(exact) ** 2
        bound = (2 * np.abs(exact) * off + off**2 + 16 * 2.0**-24 * power) / (SIZE**2 * VARIANCES)
        assert (np.abs(spectra[way] - power / (SIZE**2 * VARIANCES)) <= bound).all()
        assert bound.max() < 0.1 * spectra[way].max()
    # Parseval: the mean of all bins is the mean square of the error.
    mean = (errors(images[BLUE], frames, steps) ** 2).mean(axis=(1, 2)) / VARIANCES[:, 0, 0]
    assert spectra[BLUE].mean(axis=(1, 2)) == pytest.approx(mean, rel=1e-3)


@blue
def test_the_error_of_one_sample_has_high_frequencies_in_blue_noise_and_all_of_them_in_white(stage):
    """Of the power of white noise below 0.1 cycles a texel, samples and remapped codes keep a twentieth or so, and
    codes with the sum of two channels less than a half: measured, 0.034, 0.058 and 0.44.

    Bins of white noise are exponential with mean 1, and each is there twice: n of them have a mean within
    5 sqrt(2 / n) of 1. P(mean <= x) is below exp(-n / 2 (x - 1 - ln x)) (Chernoff): e^-40 for one half.
    """
    _, spectra, _, _ = measured(stage, frames=1)
    for kind, least in ((SAMPLE, 0.05), (CODE, 0.5), (REMAP, 0.08)):
        for way in (WHITE, TURNED):
            assert abs(spectra[way, kind][LOW].mean() - 1) < 5 * np.sqrt(2 / LOW.sum())
        assert spectra[BLUE, kind][LOW].mean() < least
        assert LOW.sum() / 2 * (least - 1 - np.log(least)) > 40
        # It is as large as that of white noise, and elsewhere.
        assert spectra[BLUE, kind].mean() == pytest.approx(1.0, abs=0.05)
        rings = radial(spectra[BLUE, kind])
        assert rings[-1] > 1.2 and rings[:4].max() < 2 * least


def fibonacci_terms(count):
    """Return of how many Fibonacci numbers `count` is the sum, without neighbours (Zeckendorf)."""
    numbers, terms = [1, 2], 0
    while numbers[-1] <= count:
        numbers.append(numbers[-1] + numbers[-2])
    for number in reversed(numbers):
        if number <= count:
            count, terms = count - number, terms + 1
    return terms


@animated
@pytest.mark.parametrize("frames", [16, 233, 256])
def test_the_mean_over_frames_of_the_golden_ratio_is_right_at_each_texel(stage, frames):
    """Denjoy and Koksma: the sum over F(k) turns by the golden ratio of a function of the circle is off by its
    variation at most. That of a sample is 2. A code rises by two and falls by two: 4. Its mean is right, since the
    fraction of its noise is uniform over all turns: that of a sum of two is 2u + c, and the halves of a triangle fill
    each other's gaps. Frames are the sum of some Fibonacci numbers, each of which adds as much.
    """
    images, _, _, _ = measured(stage, frames=frames, steps=4)
    terms = fibonacci_terms(frames)
    assert (terms, frames) in ((2, 16), (1, 233), (3, 256))
    for way in (TURNED, BLUE):
        error = errors(images[way], frames, 4) * frames
        assert np.abs(error[SAMPLES]).max() <= 2 * terms
        assert np.abs(error[[CODES, REMAPS]]).max() <= 4 * terms
    white = errors(images[WHITE], frames, 4) * frames
    if frames > 16:  # a standard deviation of half the root of the frames, and 128^2 texels
        assert np.abs(white[SAMPLES]).max() > 2 * 2 * terms


@animated
def test_the_error_of_a_mean_falls_with_the_root_of_independent_frames_and_faster_with_turns(stage):
    """The mean square of n normal errors deviates by the root of 2 / n; a third more is allowed for others."""
    for frames in (8, 64):
        _, spectra, _, _ = measured(stage, frames=frames)
        mean = spectra[:, SAMPLES].mean(axis=(1, 2)) * frames
        assert abs(mean[WHITE] - 1) < 5 * 1.34 * np.sqrt(2) / SIZE
        terms = fibonacci_terms(frames)
        for way in (TURNED, BLUE):
            assert mean[way] < (2 * terms) ** 2 * 6 / frames, "by the bound at each texel"
            assert mean[way] < (0.3 if frames == 8 else 0.05), "measured: 0.20 and 0.034"


@animated
def test_triangular_noise_has_the_same_error_for_each_light(stage):
    """E of the squared error of a code is 1/4 wherever the light lies between codes; with one number in place of two it
    would be f (1 - f) for a fraction f, 0 on a code. A squared error is at most 9/4, so 4,096 of them have a mean
    within 5 / 64 of the deviation, which is at most a half of 9/4."""
    images, _, _, _ = measured(stage, frames=1, steps=8)
    fraction = np.abs(LIGHT * 8 - np.round(LIGHT * 8))
    for way in range(3):
        for number, kind in ((1, CODE), (2, REMAP)):
            noise, error = images[way, number].astype(np.float64), errors(images[way], 1, 8)[kind]
            assert noise.min() >= -1 and noise.max() < 1
            assert abs(noise.mean()) < 5 / np.sqrt(6) / SIZE
            # Of the squares: mean 1/6, mean square 1/15.
            assert abs((noise**2).mean() - 1 / 6) < 5 * np.sqrt(1 / 15 - 1 / 36) / SIZE
            for group in (fraction < 0.125, fraction > 0.375):
                assert group.sum() * SIZE >= 4096
                assert abs((error[:, group] ** 2).mean() - 0.25) < 5 / 64 * 9 / 8
        one = np.floor(LIGHT * 8 + images[way, 0]) - LIGHT * 8
        assert (one[:, fraction < 0.125] ** 2).mean() < 0.25 - 5 / 64 * 9 / 8 < (one**2).max()


@blue
def test_the_picture_shows_a_texel_for_a_pixel(stage):
    images, spectra, picture, work = measured(stage, (768, 768), frames=16)
    assert (work["dispatches"], work["draws"]) == (3, 1)
    for way in range(3):
        for kind in range(6):
            cell = picture[128 * kind : 128 * (kind + 1), 256 * way : 256 * (way + 1)]
            light = errors(images[way], 16, 4)[kind] / (1 if kind < 2 else 4) + LIGHT
            light = np.clip(light, 0, 1)
            coded = np.where(light <= 0.0031308, 12.92 * light, 1.055 * light ** (1 / 2.4) - 0.055)
            assert np.abs(cell[:, :128].astype(float) - 255 * coded[..., None]).max() <= (
                codes_off(stage.device) + 0.1
            )
            shown = np.clip((np.log10(np.maximum(spectra[way, kind], 1e-30)) + 5) / 6, 0, 1)
            green = np.fft.fftshift(255 * shown**2)
            assert np.abs(cell[:, 128:, 1] - green).max() <= codes_off(stage.device) + 0.5


@blue
def test_counters_tell_the_power_at_low_frequencies(stage):
    with stage.open(WHICH, (48, 48), settings=Settings(frames=16)) as renderer:
        frame = renderer.render(chapters.view_of(renderer))
        work, spectra = frame.work, renderer.spectra()
    for way, name in enumerate(("white", "turned", "blue")):
        for kind, row in enumerate(("sample", "samples", "code", "codes", "remap", "remaps")):
            spectrum = spectra[way, kind].astype(np.float64)
            if row in ("sample", "code", "remap"):
                assert work[f"{name}_{row}_low"] == pytest.approx(1e6 * spectrum[LOW].mean(), rel=1e-4)
            else:
                assert work[f"{name}_{row}_all"] == pytest.approx(1e6 * spectrum.mean(), rel=1e-4)


@pytest.mark.parametrize("asked", ["frames=0", "frames=257", "first=-1", "steps=256", "frames=nan"])
def test_numbers_out_of_range_are_refused_in_one_sentence(asked):
    with pytest.raises(SettingError, match=asked.split("=")[0]) as found:
        apply_overrides(Settings(), [asked])
    assert "\n" not in str(found.value)
