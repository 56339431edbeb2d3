"""The sRGB transfer functions of `shaders/srgb.glsl` against the curve in float64.

Their domain is 0 to 1. Outside it nothing is promised but that a NaN stays one and an infinity does not become a
number: what is written to a picture is clamped before.
"""

from __future__ import annotations

import numpy as np
import pytest

from common.images.color import decode_srgb, encode_srgb
from tests.support.drivers import needs_nans
from tests.support.either import evaluate
from tests.support.gpu_functions import ulps

srgb_transfer = pytest.mark.feature("images/srgb-transfer")

KNEE_CODED, KNEE_LIGHT = np.float32(0.04045), np.float32(0.0031308)


def run(device, body, result, name, values):
    """Return what `body` makes of `values` (N,), after seeing that all three channels agree."""
    rows = np.repeat(np.float32(values)[:, None], 3, axis=1)
    got = evaluate(device, ["srgb.glsl"], body, {name: rows}, {result: "vec3"})[result]
    assert np.array_equal(got[:, 0], got[:, 1], equal_nan=True)
    assert np.array_equal(got[:, 0], got[:, 2], equal_nan=True)
    return got[:, 0]


def decode(device, values):
    """Return the GPU's linear values (N,) of coded ones (N,)."""
    return run(device, "light = linear_from_srgb(coded);", "light", "coded", values)


def encode(device, values):
    """Return the GPU's coded values (N,) of linear ones (N,)."""
    return run(device, "coded = srgb_from_linear(light);", "coded", "light", values)


def allowed(device):
    """Return ulps that `pow` may be off: exp2(y log2 x) of the Vulkan specification allows this much in 0..1.

    Measured are 12 on the software driver and 10 on an H200.
    """
    return 16 if device.capabilities.is_software else 64


def off(device, got, truth):
    """Return ulps between `got` and `truth`; hardware may put 0 in place of a denormal.

    A shader that does not ask for denormals (`shaderDenormPreserveFloat32`) leaves them to the device. NVIDIA's flushes
    them, the software driver keeps them.
    """
    flushed = (got == 0) & (truth < np.finfo(np.float32).tiny) & (not device.capabilities.is_software)
    return np.where(flushed, 0.0, ulps(got, truth))


def spread():
    """Return float32 values of 0..1: evenly, by powers of two down to denormals, and both sides of both knees."""
    knees = [np.nextafter(knee, np.float32(side)) for knee in (KNEE_CODED, KNEE_LIGHT) for side in (0, 1)]
    values = [
        np.linspace(0, 1, 20_001),
        2.0 ** np.arange(-126, 1),
        np.random.default_rng(3).random(20_000) ** 4,
    ]
    return np.concatenate([*values, knees, [KNEE_CODED, KNEE_LIGHT]]).astype(np.float32)


@srgb_transfer
def test_every_byte_survives_decoding_and_encoding(either_device):
    codes = np.arange(256) / np.float32(255)
    light = decode(either_device, codes)
    assert ulps(light, decode_srgb(codes)).max() <= allowed(either_device)
    assert np.array_equal(np.rint(encode(either_device, light) * 255), np.arange(256))


@srgb_transfer
@pytest.mark.parametrize(("function", "truth"), [(decode, decode_srgb), (encode, encode_srgb)])
def test_the_curve_is_exact_to_a_few_units_in_the_last_place(either_device, function, truth):
    values = spread()
    got = function(either_device, values)
    assert off(either_device, got, truth(values)).max() <= allowed(either_device)
    assert got[values == 0].tolist() == [0.0]


@srgb_transfer
@pytest.mark.parametrize(("function", "top"), [(decode, 1.0), (encode, 1.0)])
def test_the_curve_rises_and_stays_between_0_and_1(either_device, function, top):
    values = np.sort(spread())
    got = function(either_device, values)
    # `pow` may be off by a few units, so neighbours may swap by as much, and the knee may be that high.
    assert (np.diff(got.astype(np.float64)) >= -allowed(either_device) * 2.0**-24).all()
    assert got[0] == 0.0
    assert abs(got[-1] - top) < 1e-6


@srgb_transfer
def test_there_and_back_is_the_same_light(either_device):
    light = np.linspace(0, 1, 10_001, dtype=np.float32)
    assert np.abs(decode(either_device, encode(either_device, light)) - light).max() < 2e-6


@pytest.mark.parametrize("function", [decode, encode])
def test_values_outside_the_domain_keep_their_kind(vulkan_device, function):
    needs_nans(vulkan_device)
    got = function(vulkan_device, [np.nan, np.inf, -np.inf, -0.001, -0.0, -1.0, 2.0])
    assert np.isnan(got[0])
    assert np.array_equal(got[1:3], [np.inf, -np.inf])
    assert np.isfinite(got[3:]).all()
    assert (got[3:6] <= 0).all()
    assert got[6] > 1.0
