"""Mip chains on the CPU against box filters in float64; that GPUs make the same is in tests/backends."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from common.images.color import decode_srgb, encode_srgb
from common.images.mips import halved, mip_chain

SIZES = [(1, 1), (2, 1), (1, 5), (3, 2), (8, 8), (17, 9), (100, 37), (64, 3)]


def box(above: int) -> np.ndarray:
    """Return (below, above) weights: how much of each source texel a target texel covers, by their overlap."""
    below = max(1, above // 2)
    edges = np.arange(below + 1) * above / below
    low = np.maximum(edges[:-1, None], np.arange(above))
    high = np.minimum(edges[1:, None], np.arange(1, above + 1))
    return np.clip(high - low, 0, None) * below / above


def filtered(values: np.ndarray) -> np.ndarray:
    return np.einsum("yh,xw,hwc->yxc", box(values.shape[0]), box(values.shape[1]), values)


@pytest.mark.parametrize("channels", [1, 2, 4])
@pytest.mark.parametrize("size", SIZES)
def test_every_level_is_the_box_filter_of_the_one_above(size, channels):
    pixels = np.random.default_rng(5).integers(0, 256, (size[1], size[0], channels), np.uint8)
    levels = mip_chain(pixels, False)
    assert len(levels) == max(size).bit_length() and levels[-1].shape == (1, 1, channels)
    assert np.array_equal(levels[0], pixels)
    for above, level in pairwise(levels):
        assert np.abs(level - filtered(above.astype(np.float64))).max() <= 0.5 + 1e-4, "to the nearest code"


@pytest.mark.parametrize("size", SIZES)
def test_srgb_colour_is_averaged_as_light_and_alpha_as_it_is(size):
    pixels = np.random.default_rng(6).integers(0, 256, (size[1], size[0], 4), np.uint8)
    pixels[: size[1] // 2, :, :3] //= 16  # near black, where the curve is steepest
    for above, level in pairwise(mip_chain(pixels, True)):
        light = above / 255.0
        light[..., :3] = decode_srgb(light[..., :3])
        truth = filtered(light)
        truth[..., :3] = encode_srgb(truth[..., :3])
        # Half a code, and that half a step of light is at most a fortieth of a code.
        assert np.abs(level - truth * 255).max() <= 0.5 + 1 / 20


def test_of_two_equally_near_codes_the_even_one_is_taken():
    pixels = np.array([[0, 1], [0, 1]], np.uint8)[..., None]
    assert halved(pixels, False)[0, 0, 0] == 0
    assert halved(pixels + 1, False)[0, 0, 0] == 2
