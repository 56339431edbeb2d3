"""The study separable-bloom: the weights of its blur, its bright pass, and what one texel becomes."""

from __future__ import annotations

import numpy as np
import pytest

import chapters
from chapters.ch07.studies import separable_bloom as study
from chapters.ch07.studies.separable_bloom import SIDE, TAPS, Settings
from tests.support.bounds import codes_off
from tests.twins.hdr import tone_reinhard

WHICH = "7/separable-bloom"
WEIGHTS = np.array([3, 6, 10, 15, 20, 25, 20, 15, 10, 6, 3], np.float64)
"""As the cookbook prints them, repaired: with a sum of 133."""

VARIANCE = 5.128


def blurred(stage, monkeypatch, picture=None, **knobs):
    """Return the bloom of a picture (SIDE, SIDE, 3) that the kernels leave, and the frame's work."""
    if picture is not None:
        texels = np.concatenate([picture, np.ones((SIDE, SIDE, 1))], -1).astype(np.float32)
        module = chapters.renderer_module(WHICH, stage.backend)
        monkeypatch.setattr(module.Renderer, "light", staticmethod(lambda: texels))
    with stage.open(WHICH, (8, 8), settings=Settings(**knobs)) as renderer:
        work = renderer.render(chapters.view_of(renderer)).work
        return renderer.blurred().astype(np.float64), work


def impulse(at=(120, 131), color=(133.0, 266.0, 1330.0)):
    picture = np.zeros((SIDE, SIDE, 3))
    picture[at] = color
    return picture


def variance(line):
    place = np.arange(len(line))
    middle = (line * place).sum() / line.sum()
    return (line * (place - middle) ** 2).sum() / line.sum()


@pytest.mark.feature("postprocess/separable-blur")
def test_an_impulse_gives_the_weights(stage, monkeypatch):
    """3, 6, 10, 15, 20, 25, ... over 133 along each axis, with variance 5.128; a product of both in the square."""
    assert WEIGHTS.sum() == 133 and variance(WEIGHTS) == pytest.approx(VARIANCE, abs=5e-4)
    assert tuple(WEIGHTS) == TAPS
    found, _ = blurred(stage, monkeypatch, impulse(), repeats=1)
    around = found[120 - 5 : 120 + 6, 131 - 5 : 131 + 6]
    for channel, value in enumerate((133.0, 266.0, 1330.0)):
        wanted = np.outer(WEIGHTS, WEIGHTS) * value / 133**2
        np.testing.assert_allclose(around[..., channel], wanted, rtol=1e-6)
    assert np.count_nonzero(found[..., 0]) == 121


@pytest.mark.feature("postprocess/separable-blur")
def test_constants_are_preserved(stage, monkeypatch):
    """Also at the border. A blur without its division, or with ten taps, would not."""
    picture = np.full((SIDE, SIDE, 3), (1.0, 7.5, 60_000.0))
    found, _ = blurred(stage, monkeypatch, picture, threshold=0.0)
    np.testing.assert_allclose(found, picture, rtol=8 * 1e-6)


@pytest.mark.feature("postprocess/separable-blur")
def test_a_wrong_weight_is_noticed(stage, monkeypatch):
    """With one weight of another size, constants change, and an impulse has another sum and variance."""
    monkeypatch.setattr(study, "TAPS", (*TAPS[:-1], 0))
    found, _ = blurred(stage, monkeypatch, np.ones((SIDE, SIDE, 3)), threshold=0.0, repeats=1)
    np.testing.assert_allclose(found, (130 / 133) ** 2, rtol=1e-5)
    found, _ = blurred(stage, monkeypatch, impulse(), repeats=1)
    assert abs(variance(found[..., 0].sum(0)) - VARIANCE) > 0.2


@pytest.mark.feature("hdr/bloom")
def test_four_blurs_spread_an_impulse_by_four_variances_at_constant_energy(stage, monkeypatch):
    found, work = blurred(stage, monkeypatch, impulse())
    np.testing.assert_allclose(found.sum((0, 1)), (133.0, 266.0, 1330.0), rtol=1e-5)
    for axis in (0, 1):
        assert variance(found[..., 1].sum(axis)) == pytest.approx(4 * variance(WEIGHTS), rel=1e-4)
    assert work["dispatches"] == 9 and work["fetched"] == SIDE**2 * (1 + 8 * 11)


@pytest.mark.feature("hdr/bloom")
def test_texels_of_weighted_luminance_below_1_become_black_and_others_pass(stage, monkeypatch):
    """By the weights 0.33, 0.34, 0.33, which sum up to 1: a grey of exactly 1 passes, to the rounding of the sum."""
    rng = np.random.default_rng(4)
    picture = np.float32(rng.uniform(0.0, 2.0, (SIDE, SIDE, 3))).astype(np.float64)
    picture[0, 0], picture[0, 1] = (0.0, 0.0, 3.0), (0.0, 0.0, 3.125)
    picture[0, 2], picture[0, 3] = np.inf, (np.nan, 5.0, 1e9)
    found, work = blurred(stage, monkeypatch, picture, repeats=0)
    weighted = picture @ np.array([0.33, 0.34, 0.33])
    sure = np.abs(weighted - 1.0) > 1e-6
    sure[0, 2:4] = False
    expected = np.where((weighted >= 1.0)[..., None], picture, 0.0)
    assert np.array_equal(found[sure], expected[sure])
    assert 0.3 < (found[..., 0] > 0).mean() < 0.7
    assert found[0, 0].max() == 0.0 and found[0, 1, 2] > 3.0, "0.99 is dark, 1.031 is bright"
    assert (found[0, 2] == 65504.0).all() and found[0, 3].tolist() == [0.0, 5.0, 65504.0]
    assert work["dispatches"] == 1


@pytest.mark.feature("hdr/bloom")
def test_a_picture_without_bright_texels_is_shown_as_it_is(stage, monkeypatch):
    """And with them the right half is brighter: light is added before the curve, so nothing exceeds white."""
    found, _ = blurred(stage, monkeypatch, threshold=50_000.0)
    assert not found.any()
    size = (SIDE, SIDE)
    plain = stage.draw(WHICH, size, settings=Settings(strength=0.0))["color"].astype(int)
    dark = stage.draw(WHICH, size, settings=Settings(threshold=50_000.0))["color"]
    glow = stage.draw(WHICH, size)["color"].astype(int)
    assert np.array_equal(plain, dark)
    assert np.array_equal(plain[:, : SIDE // 2], glow[:, : SIDE // 2])
    assert (glow >= plain).all() and (glow[:, SIDE // 2 :] > plain[:, SIDE // 2 :]).mean() > 0.2
    module = chapters.renderer_module(WHICH, stage.backend)
    light = tone_reinhard(module.Renderer.light()[..., :3], 1.17)
    codes = np.where(light <= 0.0031308, light * 12.92, 1.055 * light ** (1 / 2.4) - 0.055) * 255
    assert np.abs(plain - codes).max() < codes_off(stage.device) + 0.03
