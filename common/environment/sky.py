"""A clear sky with its sun as an environment in nits: no file is needed to see a scene in daylight.

The sky is that of Preetham, Shirley and Smits 1999 ("A Practical Analytic Model for Daylight"), fitted by them to a
simulation of the atmosphere: luminance and chromaticity are each Perez's five-parameter formula. It is up to twice as
bright as what is measured (Zotti, Wilkie and Purgathofer 2007, "A Critical Review of the Preetham Skylight Model").

The direct light of the sun is that of Darula and Kittler 2002 ("CIE General Sky Standard Defining Luminance
Distributions"), its colour by the transmittances of Preetham's appendix. Below the horizon lies grey ground. Everything
is float64.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from common.environment import Environment
from common.environment.directions import panorama_directions, panorama_solid_angles, panorama_uv
from common.images.color import LUMINANCE

Float64 = NDArray[np.float64]

SUN_RADIUS = math.radians(0.2666)
"""Mean angular radius of the sun's disc."""
SOLAR_CONSTANT = 133_800.0
"""Illuminance by the sun outside the atmosphere, lux."""

# Rows: luminance Y, chromaticities x and y; columns: Perez's A to E, each slope * turbidity + start.
_SLOPES = np.array(
    [
        [0.1787, -0.3554, -0.0227, 0.1206, -0.0670],
        [-0.0193, -0.0665, -0.0004, -0.0641, -0.0033],
        [-0.0167, -0.0950, -0.0079, -0.0441, -0.0109],
    ]
)
_STARTS = np.array(
    [
        [-1.4630, 0.4275, 5.3251, -2.5771, 0.3703],
        [-0.2592, 0.0008, 0.2125, -0.8989, 0.0452],
        [-0.2608, 0.0092, 0.2102, -1.6537, 0.0529],
    ]
)
# Chromaticity of the zenith: [T^2, T, 1] M [s^3, s^2, s, 1] with the sun's angle from the zenith s.
_ZENITH_X = np.array(
    [
        [0.00166, -0.00375, 0.00209, 0.0],
        [-0.02903, 0.06377, -0.03202, 0.00394],
        [0.11693, -0.21196, 0.06052, 0.25886],
    ]
)
_ZENITH_Y = np.array(
    [
        [0.00275, -0.00610, 0.00317, 0.0],
        [-0.04214, 0.08970, -0.04153, 0.00516],
        [0.15346, -0.26756, 0.06670, 0.26688],
    ]
)
_RGB_FROM_XYZ = np.array(
    [
        [3.2404542, -1.5371385, -0.4985314],
        [-0.9692660, 1.8760108, 0.0415560],
        [0.0556434, -0.2040259, 1.0572252],
    ]
)
_WAVELENGTHS = np.array([0.615, 0.535, 0.445])  # micrometres that stand for red, green and blue


def sun_direction(altitude: float, azimuth: float) -> Float64:
    """Return the unit vector to the sun: altitude above the horizon, azimuth from -z to the right, in radians."""
    return np.array(
        [
            math.cos(altitude) * math.sin(azimuth),
            math.sin(altitude),
            -math.cos(altitude) * math.cos(azimuth),
        ]
    )


def zenith(turbidity: float, sun_angle: float) -> Float64:
    """Return luminance in nits and chromaticities x, y (3,) straight up; `sun_angle` is the sun's from the zenith."""
    chi = (4 / 9 - turbidity / 120) * (math.pi - 2 * sun_angle)
    luminance = (4.0453 * turbidity - 4.9710) * math.tan(chi) - 0.2155 * turbidity + 2.4192
    powers = np.array([turbidity**2, turbidity, 1.0])
    angles = np.array([sun_angle**3, sun_angle**2, sun_angle, 1.0])
    return np.array([1000 * luminance, powers @ _ZENITH_X @ angles, powers @ _ZENITH_Y @ angles])


def sky_yxy(directions: ArrayLike, sun: ArrayLike, turbidity: float) -> Float64:
    """Return luminance in nits and chromaticities x, y of the sky (..., 3) in unit directions (..., 3) above ground.

    Turbidity is how much more the air scatters than clean air: 2 is very clear, 3 clear, 6 hazy; the fit holds from 2
    to about 10.
    """
    d, sun = np.asarray(directions, np.float64), np.asarray(sun, np.float64)
    a, b, c, e, f = np.moveaxis(_SLOPES * turbidity + _STARTS, -1, 0)

    def perez(cosine: Float64, cos_gamma: Float64) -> Float64:
        cosine, cos_gamma = np.maximum(cosine, 1e-3)[..., None], np.clip(cos_gamma, -1, 1)[..., None]
        gamma = np.arccos(cos_gamma)
        return (1 + a * np.exp(b / cosine)) * (1 + c * np.exp(e * gamma) + f * cos_gamma**2)

    straight_up = perez(np.ones(()), sun[1])
    here = perez(d[..., 1], d @ sun)
    return zenith(turbidity, math.acos(min(max(float(sun[1]), -1.0), 1.0))) * here / straight_up


def rgb_from_yxy(yxy: ArrayLike) -> Float64:
    """Return linear sRGB colours (..., 3) of luminance and chromaticities; those outside the gamut are cut at 0."""
    yxy = np.asarray(yxy, np.float64)
    luminance, x, y = yxy[..., 0], yxy[..., 1], yxy[..., 2]
    xyz = np.stack([x / y, np.ones_like(y), (1 - x - y) / y], axis=-1) * luminance[..., None]
    return np.maximum(xyz @ _RGB_FROM_XYZ.T, 0.0)


def air_mass(altitude: float) -> float:
    """Return how much more air lies before the sun than straight up (Kasten and Young 1989)."""
    degrees = max(math.degrees(altitude), 0.0)
    return 1 / (math.sin(math.radians(degrees)) + 0.50572 * (degrees + 6.07995) ** -1.6364)


def sun_illuminance(altitude: float, turbidity: float) -> Float64:
    """Return what the sun alone gives a surface that faces it, in lux by colour (3,); 0 below the horizon."""
    if altitude <= 0:
        return np.zeros(3)
    mass = air_mass(altitude)
    illuminance = SOLAR_CONSTANT * math.exp(-turbidity * mass / (9.9 + 0.043 * mass))
    scattered = 0.008735 * _WAVELENGTHS**-4.08  # by molecules
    haze = (0.04608 * turbidity - 0.04586) * _WAVELENGTHS**-1.3
    color = np.exp(-mass * (scattered + haze))
    return np.asarray(color / (color @ LUMINANCE) * illuminance)


def sky(
    altitude: float = math.radians(40.0),
    azimuth: float = math.radians(35.0),
    turbidity: float = 2.5,
    ground: float = 0.2,
    height: int = 256,
) -> Environment:
    """Return the environment of a clear day, (height, 2 * height) pixels; angles in radians, see `sun_direction`.

    `ground` is the albedo of what lies below the horizon, lit by sky and sun. The sun's light is shared out among the
    pixels that its disc covers, so that its illuminance is exact however large a pixel is. Raises ValueError for a sun
    below the horizon or a turbidity for which the model was not made.
    """
    if not 0 < altitude <= math.pi / 2:
        raise ValueError("the sun stands above the horizon: altitude from 0 to pi / 2")
    if not 1.9 <= turbidity <= 10:
        raise ValueError(f"turbidity is from 1.9 to 10, not {turbidity}")
    sun = sun_direction(altitude, azimuth)
    directions, areas = panorama_directions(height), panorama_solid_angles(height)
    light = rgb_from_yxy(sky_yxy(directions, sun, turbidity))
    above = directions[..., 1] > 0
    light[~above] = 0.0
    direct = sun_illuminance(altitude, turbidity)
    received = np.einsum("hwc,hw->c", light, np.maximum(directions[..., 1], 0) * areas) + direct * sun[1]
    light += _sun_share(sun, height)[..., None] / areas[..., None] * direct
    light[~above] = ground / math.pi * received
    return Environment(f"sky at {math.degrees(altitude):.0f} degrees", light.astype(np.float32))


def _sun_share(sun: Float64, height: int) -> Float64:
    """Return the part of the sun's disc that each pixel (height, 2 * height) covers, those above the horizon; sum 1."""
    # Points spread evenly over the disc (a spiral by the golden angle; Vogel 1979), each given to its pixel.
    count = 4096
    number = np.arange(count) + 0.5
    radius, turn = SUN_RADIUS * np.sqrt(number / count), number * math.pi * (3 - math.sqrt(5))
    aside = np.cross(sun, (1.0, 0.0, 0.0) if abs(sun[0]) < 0.9 else (0.0, 0.0, 1.0))
    aside /= np.linalg.norm(aside)
    other = np.cross(sun, aside)
    points = (
        np.cos(radius)[:, None] * sun
        + (np.sin(radius) * np.cos(turn))[:, None] * aside
        + (np.sin(radius) * np.sin(turn))[:, None] * other
    )
    uv = panorama_uv(points)
    column = np.minimum((uv[:, 0] * 2 * height).astype(np.intp), 2 * height - 1)
    row = np.minimum((uv[:, 1] * height).astype(np.intp), height // 2 - 1)  # a setting sun stays whole
    share = np.zeros((height, 2 * height))
    np.add.at(share, (row, column), 1 / count)
    return share
