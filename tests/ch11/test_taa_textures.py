"""Textures under a history: their levels with a bias, and their places without jitter."""

from __future__ import annotations

import numpy as np
import pytest

from chapters.ch11.settings import Settings
from common.numerics.transforms import pose_looking_at
from common.scene import Image, Material, Sampler
from common.view.camera import Orthographic, View
from tests.support.bounds import level_step
from tests.support.scenes import quad_scene, texture
from tests.support.taa import FULL, light, opened

pytestmark = pytest.mark.variants("vulkan", "gl")

TEXELS, SIZE = 64, (32, 32)
SMOOTH = Sampler("linear", "linear", "linear")
BASE = Settings(**{**FULL, "jitter_period": 1, "gbuffer_format": "full", "graph": "deferred"})
SHIFT = 2.0 / TEXELS * 0.5
"""Half a texel of a square of two metres: pixels lie on texels of the finest level, and between those of the next."""


def noisy():
    """Return a square whose texels are random, unlit, with a level for each halving."""
    texels = np.random.default_rng(3).integers(0, 256, (TEXELS, TEXELS, 4), np.uint8)
    texels[..., 3] = 255
    material = Material(unlit=True, base_color_texture=texture(sampler=SMOOTH), double_sided=True)
    return quad_scene(material, images=(Image("noise", texels),))


def facing(shift=SHIFT):
    """Return a view of two texels to a pixel: level 1 is the level of each pixel."""
    return View(pose_looking_at((shift, shift, 2.0), (shift, shift, 0.0)), Orthographic(1.0, 0.1, 4.0))


def picture(chapter, **turned):
    with opened(chapter, BASE, noisy(), size=SIZE, **turned) as renderer:
        return light(renderer.render(facing()))[2:-2, 2:-2]


@pytest.mark.feature("taa/mip-bias")
@pytest.mark.parametrize("surfaces", ["gbuffer", "visibility"])
def test_a_bias_of_a_quarter_mixes_a_quarter_of_the_finer_level(chapter, surfaces):
    """A bias of 3/4 of a level is 1/4 of a bias of 0 and 3/4 of one of 1, since filters between levels are linear.

    The levels of all three may be off by a step on hardware, and the software driver takes whole ones exactly. A step
    changes the picture by its part of the difference of two levels: of these, and for the coarser one also of the next.
    Below the finest level there would be nothing to mix.
    """
    software = chapter.device.capabilities.is_software
    whole, finer, between = (picture(chapter, mip_bias=bias, surfaces=surfaces) for bias in (1.0, 0.0, 0.75))
    coarsest = whole if software else picture(chapter, mip_bias=2.0, surfaces=surfaces)
    apart = np.abs(finer - whole)
    assert apart.mean() > 0.05 * whole.mean()
    step = level_step(chapter.device, given_gradients=surfaces == "visibility")
    of_whole = 0.25 * apart + 0.75 * np.maximum(apart, np.abs(coarsest - whole))
    off = apart + (0.0 if software else of_whole)
    assert (np.abs(between - (0.25 * finer + 0.75 * whole)) <= step * off + 1e-3 * whole.max()).all()


@pytest.mark.feature("taa/mip-bias")
def test_without_a_history_there_is_no_bias(chapter):
    off = picture(chapter, taa="off", mip_bias=0.0)
    assert np.array_equal(picture(chapter, taa="off", mip_bias=-1.0), off)
    assert np.array_equal(picture(chapter, mip_bias=0.0), off)
    assert not np.array_equal(picture(chapter, mip_bias=1.0), off)


@pytest.mark.feature("taa/uv-unjitter")
@pytest.mark.parametrize("surfaces", ["gbuffer", "visibility"])
def test_textures_without_jitter_stand_still(chapter, surfaces):
    """Each frame of a period shows the same texels inside of the square, but for the rounding of places."""
    settings = {
        "jitter_period": 4,
        "mip_bias": 0.0,
        "taa_share": 1.0,
        "taa_average": False,
        "surfaces": surfaces,
    }
    steady, moved = [], []
    for frames, steady_uv in ((steady, True), (moved, False)):
        with opened(chapter, BASE, noisy(), size=SIZE, **settings, steady_uv=steady_uv) as renderer:
            frames += [light(renderer.render(facing()))[2:-2, 2:-2] for _ in range(4)]
    largest = max(frame.max() for frame in steady)
    for frame in steady[1:]:
        assert np.abs(frame - steady[0]).max() < 0.02 * largest
        assert not np.array_equal(frame, moved[1])
    assert np.abs(moved[1] - moved[0]).mean() > 0.02 * largest
