"""Weights of two strategies: they sum to one for every pair of densities, and combine samples without bias."""

from __future__ import annotations

import numpy as np
import pytest

from tests.support.either import evaluate

feature = pytest.mark.feature("path-tracer/mis")

DENSITIES = [0.0, 1e-45, 1e-38, 1.2e-38, 1e-30, 1e-19, 1e-3, 0.5, 1.0, 3e5, 1e18, 1e20, 1e37, 3.4e38, np.inf]


def weights(device, a, b):
    """Return the shader's weights of the first strategy and of the second, in float64."""
    body = "first = power_heuristic(a, b); second = power_heuristic(b, a);"
    inputs = {"a": np.float32(a), "b": np.float32(b)}
    got = evaluate(device, ["mis.glsl"], body, inputs, {"first": "float", "second": "float"})
    return got["first"].astype(np.float64), got["second"].astype(np.float64)


@feature
def test_weights_sum_to_one_for_all_densities(either_device):
    a, b = (x.reshape(-1) for x in np.meshgrid(np.float32(DENSITIES), np.float32(DENSITIES)))
    first, second = weights(either_device, a, b)
    assert np.abs(first + second - 1).max() <= 2.0**-23
    assert first.min() >= 0 and first.max() <= 1
    assert (first[np.isinf(a) & (b < 1e18)] == 1).all() and (first[np.isinf(b) & (a < 1e18)] == 0).all()
    assert (first[a == b] == 0.5).all()
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        printed = a**2 / (a**2 + b**2)
    assert not np.isfinite(printed).all(), "squares of densities as they are overflow and vanish"


@feature
def test_weights_are_the_squares_shares(either_device):
    a, b = 10.0 ** np.random.default_rng(2).uniform(-18, 18, (2, 20_000))
    b[::2] = a[::2] * 10.0 ** np.random.default_rng(3).uniform(-2, 2, 10_000)
    a, b = np.float32(a), np.float32(b)
    first, _ = weights(either_device, a, b)
    x, y = a.astype(np.float64), b.astype(np.float64)
    truth = 1 / (1 + (y / x) ** 2)
    # Division 2.5 ulp and squares of both, their sum, and a division again.
    assert (np.abs(first - truth) <= 12 * 2.0**-23 * truth + 1e-37).all()


@feature
def test_the_combined_estimate_agrees_with_each_strategy(vulkan_device):
    """The integral of 3 x^2 (1 + sin(40 x) / 2) over 0 to 1, by even and by x-proportional samples, and by both."""
    count = 200_000
    u = np.random.default_rng(6).random((2, count))

    def f(x):
        return 3 * x * x * (1 + np.sin(40 * x) / 2)

    # The integral of 3 x^2 sin(40 x) / 2 by parts.
    c, s = np.cos(40.0), np.sin(40.0)
    truth = 1 + 1.5 * (-c / 40 + 2 * s / 1600 + 2 * (c - 1) / 64000)
    even, rising = u[0], np.sqrt(u[1])
    first = f(even)
    second = f(rising) / (2 * rising)
    own, _ = weights(vulkan_device, np.ones(count), 2 * even)
    other, _ = weights(vulkan_device, 2 * rising, np.ones(count))
    combined = own * first + other * second
    for estimate in (first, second, combined):
        assert abs(estimate.mean() - truth) < 4 * estimate.std() / np.sqrt(count)
    assert combined.std() < first.std()
    lost = own * first + second
    assert abs(lost.mean() - truth) > 20 * lost.std() / np.sqrt(count), (
        "one strategy without its weight is noticed"
    )
