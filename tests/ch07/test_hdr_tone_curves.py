"""Tone curves as settings: their functions against float64, and each as the picture shows it."""

from __future__ import annotations

from contextlib import closing

import numpy as np
import pytest

from chapters.ch07.settings import Settings
from common.settings import replaced
from tests.support.bounds import codes_off
from tests.support.glowing import glowing
from tests.support.gpu_functions import evaluate
from tests.support.scenes import facing
from tests.twins.hdr import tone_aces, tone_reinhard
from tests.twins.shading import tone_neutral

EV = -0.2630344058337938
CURVES = {
    "neutral": tone_neutral,
    "reinhard": lambda color: tone_reinhard(color, 4.0),
    "aces": tone_aces,
    "none": lambda color: color,
}


def srgb(light):
    light = np.clip(light, 0.0, 1.0)
    return np.where(light <= 0.0031308, light * 12.92, 1.055 * light ** (1 / 2.4) - 0.055)


@pytest.mark.parametrize("white", [0.5, 1.17, 4.0, 1000.0])
def test_reinhards_curve_reaches_white_where_it_is_told(vulkan_device, white):
    """0 is 0, the white point and all above it exactly 1, and more light is never darker."""
    numbers = np.concatenate([[0.0, white, 65504.0], np.geomspace(1e-5, 65504.0, 3000)]).astype(np.float32)
    colors = np.repeat(numbers[:, None], 3, axis=1)
    got = evaluate(
        vulkan_device,
        ["tone_curves.glsl"],
        f"shown = tone_reinhard(color, {float(white)});",
        {"color": colors},
        {"shown": "vec3"},
    )["shown"][:, 0]
    assert (
        got[0] == 0.0
        and got[1] == pytest.approx(1.0, abs=1.2e-7)
        and got[2] == pytest.approx(1.0, abs=1.2e-7)
    )
    np.testing.assert_allclose(got, tone_reinhard(numbers, white), rtol=1e-6)
    assert (np.diff(got[3:]) >= -1.2e-7).all() and got.max() <= 1.0


def test_reinhards_printed_values():
    """R(0.5) = .45509 and R(1) = .86526 at white point 1.17; R(2) would be 1.6407, which a display clamps."""
    np.testing.assert_allclose(tone_reinhard([0.5, 1.0, 2.0], 1.17), [0.45509, 0.86526, 1.0], atol=5e-6)


def test_the_fit_of_aces_is_that_of_its_formula(vulkan_device):
    rng = np.random.default_rng(8)
    colors = np.float32(np.minimum(10.0 ** rng.uniform(-5, 5, (3000, 3)), 65504.0))
    colors[0], colors[1] = 0.0, 65504.0
    got = evaluate(
        vulkan_device, ["tone_curves.glsl"], "shown = tone_aces(color);", {"color": colors}, {"shown": "vec3"}
    )["shown"]
    np.testing.assert_allclose(got, tone_aces(colors), rtol=2e-6)
    assert (got[0] == 0.0).all() and (got[1] == 1.0).all()


@pytest.mark.parametrize("curve", sorted(CURVES))
def test_the_picture_shows_the_curve(chapter, curve):
    """To half a code of 8 bits, or what the device's rounding adds to that, and single precision."""
    ramp = np.geomspace(1e-3, 200.0, 64)[:, None] * np.array([1.0, 0.6, 0.2])
    picture = np.float32(ramp.reshape(8, 8, 3))
    knobs = Settings(ambient=0.0, default_light=False, color_format="rgba32f", msaa=1)
    with closing(chapter.open(glowing(picture), (8, 8), replaced(knobs, tone_curve=curve))) as opened:
        found = opened.render(facing(ev100=EV)).image("color")
    wanted = srgb(CURVES[curve](picture.astype(np.float64))) * 255
    assert np.abs(found - wanted).max() < codes_off(chapter.device) + 0.03
