"""The tone curve of `shaders/tone.glsl` against its definition in float64, and its promises."""

from __future__ import annotations

import numpy as np

from tests.support.gpu_functions import evaluate
from tests.twins.shading import tone_neutral

LARGEST = 65504.0


def tone(device, colors):
    """Return the GPU's curve of colours (N, 3)."""
    colors = np.float32(colors)
    body = "shown = tone_neutral(color);"
    return evaluate(device, ["tone.glsl"], body, {"color": colors}, {"shown": "vec3"})["shown"]


def colors(count=50_000):
    """Return colours from black to the largest that a target holds, a third of them grey."""
    rng = np.random.default_rng(11)
    bright = 10.0 ** rng.uniform(-4, np.log10(LARGEST), (count, 1))
    mixed = rng.random((count, 3)) ** 3 * bright
    mixed[::3] = bright[::3]
    return np.concatenate([np.minimum(mixed, LARGEST), np.zeros((1, 3)), np.full((1, 3), LARGEST)]).astype(
        np.float32
    )


def test_the_curve_equals_its_definition(vulkan_device):
    """Absolute, since the toe takes two near numbers from each other: a few units of the last place of 1."""
    values = colors()
    got = tone(vulkan_device, values)
    assert np.isfinite(got).all()
    # In the rolled-off part the peak approaches 1 as 1 - d^2 / x, so everything there is of the size of 1.
    assert np.abs(got - tone_neutral(values)).max() < 1e-6


def test_no_colour_leaves_the_display(vulkan_device):
    got = tone(vulkan_device, colors())
    assert got.min() >= -1e-7
    assert got.max() <= 1.0 + 1e-6


def test_a_brighter_light_is_never_darker(vulkan_device):
    """Along a ray of constant hue the brightest channel rises; grey rises in all three, through both bends."""
    exposure = np.sort(np.concatenate([np.geomspace(1e-4, LARGEST, 4000), np.linspace(0, 2, 4000)]))[:, None]
    for hue in ((1.0, 1.0, 1.0), (1.0, 0.5, 0.2), (0.3, 0.3, 1.0), (0.0, 1.0, 0.0)):
        shown = tone(vulkan_device, exposure * np.array(hue)).max(axis=1)
        assert (np.diff(shown.astype(np.float64)) >= -2e-7).all(), hue


def test_a_saturated_colour_below_the_bend_is_left_as_it_is(vulkan_device):
    """With a channel at 0 there is no Fresnel veil to take off: the toe is the identity, bit for bit."""
    rng = np.random.default_rng(2)
    values = np.float32(rng.random((1000, 3)) * 0.75)
    values[np.arange(1000), rng.integers(0, 3, 1000)] = 0.0
    assert np.array_equal(tone(vulkan_device, values), values)


def test_below_the_bend_only_the_veil_of_a_dielectric_is_taken_off(vulkan_device):
    """A base colour under white light comes back as itself: reflected with 4 % more in every channel, and less 0.04."""
    base = np.float32(np.random.default_rng(4).uniform(0.04, 0.7, (1000, 3)))
    assert np.abs(tone(vulkan_device, base + np.float32(0.04)) - base).max() < 1e-7


def test_the_bends_have_no_step(vulkan_device):
    """Both sides of where the toe ends (darkest 0.08) and of where the roll-off begins (peak 0.76 after the veil)."""
    for at in (0.08, 0.8):
        below, above = (
            np.nextafter(np.float32(at), np.float32(0)),
            np.nextafter(np.float32(at), np.float32(1)),
        )
        shown = tone(vulkan_device, np.repeat([[below], [above]], 3, axis=1))
        assert np.abs(shown[1] - shown[0]).max() < 5e-7, at
