"""The analytic sky against what was measured of real ones, and against itself."""

from __future__ import annotations

import math

import numpy as np
import pytest

from common.environment import sky
from common.environment.directions import panorama_directions, panorama_solid_angles
from common.images.color import LUMINANCE

ALTITUDES = np.radians([5, 20, 45, 70])


@pytest.mark.parametrize("altitude", ALTITUDES)
def test_the_zenith_is_the_zenith_formula(altitude):
    sun = sky.sun_direction(altitude, 1.0)
    got = sky.sky_yxy([0.0, 1.0, 0.0], sun, 3.0)
    assert np.allclose(got, sky.zenith(3.0, math.pi / 2 - altitude), rtol=1e-12)


@pytest.mark.parametrize(
    ("altitude", "turbidity", "what"),
    [
        (0.0, 3.0, "above the horizon"),
        (-0.1, 3.0, "above the horizon"),
        (math.pi / 2 + 1e-6, 3.0, "above the horizon"),
        (1.0, 1.89, "turbidity"),
        (1.0, 10.01, "turbidity"),
    ],
)
def test_a_sun_or_an_air_that_the_model_does_not_have_is_refused(altitude, turbidity, what):
    with pytest.raises(ValueError, match=what):
        sky.sky(altitude, 0.0, turbidity)


def test_zenith_luminance_written_out():
    # T = 3, sun at 45 degrees: chi = (4/9 - 1/40) pi/2, Y = 7.1649 tan chi + 1.7727 kcd/m2.
    chi = (4 / 9 - 3 / 120) * math.pi / 2
    assert np.isclose(sky.zenith(3.0, math.pi / 4)[0], 1000 * (7.1649 * math.tan(chi) + 1.7727), rtol=1e-12)


@pytest.mark.parametrize("turbidity", [2.0, 3.0, 6.0])
@pytest.mark.parametrize("altitude", ALTITUDES)
def test_the_zeniths_colour_has_the_published_coefficients(turbidity, altitude):
    """Preetham, Shirley and Smits 1999, appendix A.2, as they are printed: rows of T^2, T and 1."""
    published = {
        1: "0.00166 -0.00375 0.00209 0 / -0.02903 0.06377 -0.03202 0.00394 / 0.11693 -0.21196 0.06052 0.25886",
        2: "0.00275 -0.00610 0.00317 0 / -0.04214 0.08970 -0.04153 0.00516 / 0.15346 -0.26756 0.06670 0.26688",
    }
    angle = math.pi / 2 - altitude
    for channel, text in published.items():
        rows = [[float(number) for number in row.split()] for row in text.split("/")]
        value = 0.0
        for power, row in zip((2, 1, 0), rows, strict=True):
            value += turbidity**power * sum(number * angle ** (3 - i) for i, number in enumerate(row))
        assert sky.zenith(turbidity, angle)[channel] == pytest.approx(value, rel=1e-12)


def test_the_sky_is_perezs_function_with_the_published_coefficients():
    """Preetham, Shirley and Smits 1999, appendix A.2, for T = 3: the ratio to the zenith in each channel."""
    published = """
        0.1787 -1.4630  -0.3554 0.4275  -0.0227 5.3251   0.1206 -2.5771  -0.0670 0.3703   luminance Y
       -0.0193 -0.2592  -0.0665 0.0008  -0.0004 0.2125  -0.0641 -0.8989  -0.0033 0.0452   chromaticity x
       -0.0167 -0.2608  -0.0950 0.0092  -0.0079 0.2102  -0.0441 -1.6537  -0.0109 0.0529   chromaticity y
    """  # slope and start of A to E, as they are printed
    channels = [[float(number) for number in row.split()[:10]] for row in published.strip().splitlines()]
    sun_angle, angle = math.radians(50.0), math.radians(70.0)  # from the zenith; both in the plane x, y
    sun = np.array([math.sin(sun_angle), math.cos(sun_angle), 0.0])
    for side in (1.0, -1.0):
        there = np.array([side * math.sin(angle), math.cos(angle), 0.0])
        got = sky.sky_yxy(there, sun, 3.0) / sky.zenith(3.0, sun_angle)
        for value, row in zip(got, channels, strict=True):
            a, b, c, d, e = (3.0 * slope + start for slope, start in zip(row[::2], row[1::2], strict=True))

            def perez(theta: float, gamma: float, a=a, b=b, c=c, d=d, e=e) -> float:
                glow = 1 + c * math.exp(d * gamma) + e * math.cos(gamma) ** 2
                return (1 + a * math.exp(b / math.cos(theta))) * glow

            gamma = abs(angle - side * sun_angle)
            assert value == pytest.approx(perez(angle, gamma) / perez(0.0, sun_angle), rel=1e-9)


def test_both_sides_of_the_sun_are_equal_and_its_side_is_brighter():
    sun = sky.sun_direction(0.6, 0.8)
    rng = np.random.default_rng(0)
    d = rng.normal(size=(500, 3))
    d[:, 1] = np.abs(d[:, 1])
    d /= np.linalg.norm(d, axis=1, keepdims=True)
    side = np.cross(sun, [0.0, 1.0, 0.0])
    side /= np.linalg.norm(side)
    mirrored = d - 2 * (d @ side)[:, None] * side
    assert np.allclose(sky.sky_yxy(d, sun, 4.0), sky.sky_yxy(mirrored, sun, 4.0), rtol=1e-12)
    there, away = sun * [1, 1, 1], sun * [-1, 1, -1]
    assert sky.sky_yxy(there, sun, 4.0)[0] > 2 * sky.sky_yxy(away, sun, 4.0)[0]


def test_colour_keeps_luminance_and_white():
    white = sky.rgb_from_yxy([2.0, 0.312727, 0.329023])  # D65 is the white of sRGB
    assert np.allclose(white, 2.0, atol=2e-3)
    yxy = sky.sky_yxy(panorama_directions(32)[:16], sky.sun_direction(0.8, 0.0), 3.0)
    rgb = sky.rgb_from_yxy(yxy)
    assert rgb.min() > 0  # nothing of a clear day lies outside the gamut
    assert np.allclose(rgb @ LUMINANCE, yxy[..., 0], rtol=2e-3)
    away = sky.rgb_from_yxy(sky.sky_yxy([0.0, 1.0, 0.0], sky.sun_direction(0.8, 0.0), 3.0))
    assert away[2] > away[1] > away[0]  # blue


@pytest.mark.parametrize("altitude", ALTITUDES)
@pytest.mark.parametrize("height", [16, 256])
def test_the_suns_illuminance_is_exact_at_every_size(altitude, height):
    day = sky.sky(float(altitude), 0.9, 3.0, height=height)
    above = panorama_directions(height)[..., 1] > 0
    without = np.where(
        above[..., None],
        sky.rgb_from_yxy(sky.sky_yxy(panorama_directions(height), sky.sun_direction(altitude, 0.9), 3.0)),
        0,
    )
    areas = panorama_solid_angles(height)[..., None]
    sun = ((day.radiance.astype(np.float64) - without) * areas * above[..., None]).sum(axis=(0, 1))
    assert np.allclose(sun, sky.sun_illuminance(altitude, 3.0), rtol=1e-4)
    # Its middle is where the sun was asked for.
    bright = np.unravel_index(day.radiance[..., 1].argmax(), above.shape)
    apart = panorama_directions(height)[bright] @ sky.sun_direction(altitude, 0.9)
    assert apart > math.cos(math.pi / height)


def test_daylight_is_as_bright_as_daylight():
    """Sun at 45 degrees: 80 to 100 klx facing it, and 10 to 20 from the sky, of which Preetham makes too much."""
    direct = sky.sun_illuminance(math.radians(45), 3.0) @ LUMINANCE
    assert 80_000 < direct < 100_000
    d, areas = panorama_directions(128)[:64], panorama_solid_angles(128)[:64]
    clear, usual = (
        (
            sky.sky_yxy(d, sky.sun_direction(math.radians(45), 0.0), turbidity)[..., 0] * d[..., 1] * areas
        ).sum()
        for turbidity in (2.0, 3.0)
    )
    assert 20_000 < clear < usual < 30_000
    day = sky.sky(math.radians(45), 0.0, 3.0, ground=0.3)
    ground = day.radiance[-1, 0] @ LUMINANCE
    assert np.isclose(ground * math.pi / 0.3, direct * math.sin(math.radians(45)) + usual, rtol=0.01)


def test_a_low_sun_is_weaker_and_redder():
    high, low = sky.sun_illuminance(1.2, 3.0), sky.sun_illuminance(0.1, 3.0)
    assert low.sum() < 0.4 * high.sum()
    assert low[0] / low[2] > 2 * high[0] / high[2]
    assert sky.sun_illuminance(-0.1, 3.0).tolist() == [0, 0, 0]
    assert np.isclose(sky.air_mass(math.pi / 2), 1.0, atol=1e-3)
    assert np.isclose(sky.air_mass(0.0), 37.9, atol=0.3)  # Kasten and Young's table at the horizon


@pytest.mark.parametrize("arguments", [{"altitude": -0.1}, {"turbidity": 1.0}, {"turbidity": 40.0}])
def test_days_that_the_model_does_not_know(arguments):
    with pytest.raises(ValueError):
        sky.sky(**arguments)
