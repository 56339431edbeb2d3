"""Double precision in shaders, where a device offers it: sums, products, quotients, roots and a polynomial.

Vulkan promises of doubles no more than of floats ("Precision of Individual Operations"), so the bounds are measured
ones; what is held besides is that they lie far below what floats could reach, 2^29 units in a double's last place.
"""

from __future__ import annotations

import numpy as np
import pytest

from tests.support import gl_functions, gpu_functions

BOUND_ULP = {"sum": 0, "product": 0, "quotient": 1, "root": 1, "polynomial": 4}
"""Measured on the software drivers: 0 for all but the polynomial, whose steps the compiler may fuse (2)."""

BODY = """
    double x = packDouble2x32(a), y = packDouble2x32(b);
    sum = unpackDouble2x32(x + y);
    product = unpackDouble2x32(x * y);
    quotient = unpackDouble2x32(x / y);
    root = unpackDouble2x32(sqrt(x));
    polynomial = unpackDouble2x32(((x * 0.25lf + 1.5lf) * x + 3.0lf) * x + 7.0lf);
"""


def operands():
    """Return two (N,) float64 arrays of positive numbers: of size 1, of every size, and neighbours of 1."""
    rng = np.random.default_rng(0)
    near = np.nextafter(1.0, [0.0, 2.0, 1.0, 2.0])
    wide = np.exp(rng.uniform(-25, 25, 500))
    return (
        np.concatenate([rng.uniform(0.5, 2, 500), wide, near]),
        np.concatenate([rng.uniform(0.5, 2, 500), wide[::-1], near[::-1]]),
    )


def ulps(got, truth):
    return np.abs(got.view(np.int64) - truth.view(np.int64))


def check(evaluate, device):
    if "fp64" not in device.capabilities.features:
        pytest.skip(
            f"fp64: {device.capabilities.why_not.get('fp64', 'the device has no doubles in shaders')}"
        )
    x, y = operands()
    pairs = {name: values.view(np.uint32).reshape(-1, 2) for name, values in (("a", x), ("b", y))}
    found = evaluate(device, [], BODY, pairs, dict.fromkeys(BOUND_ULP, "uvec2"))
    truth = {
        "sum": x + y,
        "product": x * y,
        "quotient": x / y,
        "root": np.sqrt(x),
        "polynomial": ((x * 0.25 + 1.5) * x + 3.0) * x + 7.0,
    }
    for name, bound in BOUND_ULP.items():
        got = np.ascontiguousarray(found[name]).view(np.float64)[:, 0]
        allowed = bound if device.capabilities.is_software else 1024
        worst = ulps(got, truth[name]).max()
        assert worst <= allowed, f"{name}: {worst} ulp"
        in_floats = np.float64(np.float32(truth[name]))
        assert np.abs(got - truth[name]).max() < 1e-3 * np.abs(in_floats - truth[name]).max()


@pytest.mark.feature("device/fp64-shaders")
def test_doubles_on_vulkan(vulkan_device):
    check(gpu_functions.evaluate, vulkan_device)


@pytest.mark.feature("device/fp64-shaders")
def test_doubles_on_opengl(gl_context):
    check(gl_functions.evaluate, gl_context)


@pytest.mark.feature("device/fp64-shaders")
def test_floats_would_not_pass():
    """The same sums and roots in single precision: a device that took floats for doubles is noticed."""
    x, y = operands()
    for found, truth in (
        (np.float32(x) + np.float32(y), x + y),
        (np.sqrt(np.float32(x)), np.sqrt(x)),
    ):
        assert ulps(found.astype(np.float64), truth).max() > 1000 * 1024
