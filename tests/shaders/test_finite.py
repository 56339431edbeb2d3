"""The last guard before a colour target, `finite_color` of `shaders/finite.glsl`: bit for bit."""

from __future__ import annotations

import itertools

import numpy as np

from tests.support.gpu_functions import evaluate

LARGEST = 65504.0
KINDS = {
    # value: what is written in its place
    np.nan: 0.0,
    np.inf: LARGEST,
    -np.inf: 0.0,
    3.4e38: LARGEST,
    65505.0: LARGEST,
    LARGEST: LARGEST,
    np.float32(0.1): np.float32(0.1),
    2.0**-126: 2.0**-126,
    0.0: 0.0,
    -1e-30: 0.0,
    -7.0: 0.0,
}


def test_every_kind_of_value_in_every_channel(vulkan_device):
    """All 1,331 colours of the kinds above: no channel spoils its neighbour."""
    colors = np.array(list(itertools.product(KINDS, repeat=3)), np.float32)
    expected = np.array(list(itertools.product(KINDS.values(), repeat=3)), np.float32)
    inputs = {"color": colors}
    got = evaluate(vulkan_device, ["finite.glsl"], "kept = finite_color(color);", inputs, {"kept": "vec3"})[
        "kept"
    ]
    assert np.array_equal(got, expected)


def test_every_bit_pattern_of_nan_is_caught(vulkan_device):
    """Quiet and signalling, both signs: the payload is not looked at."""
    bits = np.array([0x7FC00000, 0xFFC00000, 0x7F800001, 0xFF800001, 0x7FFFFFFF, 0xFFFFFFFF], np.uint32)
    colors = np.repeat(bits[:, None], 3, axis=1).view(np.float32)
    inputs = {"color": colors}
    got = evaluate(vulkan_device, ["finite.glsl"], "kept = finite_color(color);", inputs, {"kept": "vec3"})[
        "kept"
    ]
    assert not got.view(np.uint32).any()
