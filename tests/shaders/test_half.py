"""Rounding to half precision: `shaders/half.glsl` against numpy, bit for bit."""

from __future__ import annotations

import numpy as np

from tests.support.gpu_functions import evaluate


def test_every_number_becomes_the_nearest_half(vulkan_device):
    rng = np.random.default_rng(6)
    halves = np.arange(0x7C00, dtype=np.uint16).view(np.float16).astype(np.float32)  # all that are finite
    middles = (halves[:-1] + halves[1:]) / 2  # ties
    beside = np.concatenate([np.nextafter(middles, np.float32(0)), np.nextafter(middles, np.float32(1e9))])
    anything = np.float32(2.0 ** rng.uniform(-26, 15.99, 30_000))
    values = np.concatenate([halves, middles, beside, anything])
    values = values[: len(values) // 3 * 3].reshape(-1, 3)
    got = evaluate(vulkan_device, ["half.glsl"], "h = nearest_half(value);", {"value": values}, {"h": "vec3"})
    assert np.array_equal(got["h"], values.astype(np.float16).astype(np.float32))
