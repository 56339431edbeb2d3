"""Chapter 1's environment maps on OpenGL: the kernels are Vulkan's, and so are the numbers."""

from __future__ import annotations

import numpy as np
import pytest

from chapters.ch01.environment import gl as on_gl
from chapters.ch01.environment import model as logic
from chapters.ch01.environment import vulkan as on_vulkan
from chapters.ch01.environment.model import Sizes
from common.environment import Environment, constant
from common.environment.directions import panorama_directions

SMALL = Sizes(face=32, irradiance_face=4, irradiance_source=32, table=16, table_samples=64, lobe_part=0.3)


def sunny():
    """Return a smooth environment with a sun of one pixel."""
    pixels = 1 + 0.5 * panorama_directions(64)
    pixels[20, 30] = 5000.0
    return Environment("sunny", pixels.astype(np.float32))


def on_opengl(context, environment):
    """Return (made, all levels of all images as float16) on OpenGL."""
    maps = on_gl.create_environment(context, environment, SMALL)
    try:
        levels = [on_gl.read_cube(context, maps.radiance, level) for level in range(SMALL.levels)]
        levels.append(on_gl.read_cube(context, maps.irradiance, 0))
        return len(maps.made_ms), [*levels, on_gl.read_image(context, maps.table)]
    finally:
        maps.close(context)


@pytest.mark.feature("ibl/irradiance-convolution")
def test_both_backends_make_the_same_maps(gl_context, vulkan_device, monkeypatch):
    monkeypatch.setattr(logic, "cache_dir", lambda name: None)  # else one would read what the other has made
    made, levels = on_opengl(gl_context, sunny())
    assert made == 2
    maps = on_vulkan.create_environment(vulkan_device, sunny(), SMALL)
    try:
        images = (maps.radiance, maps.irradiance)
        truth = [level for image in images for level in on_vulkan.read_levels(vulkan_device, image)]
        truth.append(on_vulkan.read_levels(vulkan_device, maps.table)[0][0])
    finally:
        maps.close(vulkan_device)
    for one, other in zip(levels, truth, strict=True):
        assert one.shape == other.shape
        steps = np.abs(one.view(np.int16).astype(int) - other.view(np.int16).astype(int))
        assert steps.max() <= 1  # in the last place of half precision
        assert (steps > 0).mean() < 0.01


def test_what_vulkan_kept_is_read(gl_context, vulkan_device, tmp_path, monkeypatch):
    monkeypatch.setenv("STRATA_CACHE", str(tmp_path))
    maps = on_vulkan.create_environment(vulkan_device, sunny(), SMALL)
    truth = on_vulkan.read_levels(vulkan_device, maps.radiance)
    maps.close(vulkan_device)
    made, levels = on_opengl(gl_context, sunny())
    assert made == 0
    for one, other in zip(levels, truth, strict=False):
        assert np.array_equal(one, other)


@pytest.mark.feature("ibl/irradiance-convolution")
@pytest.mark.parametrize("nits", [0.25, 3000.0])
def test_a_constant_environment_stays_constant(gl_context, tmp_path, monkeypatch, nits):
    monkeypatch.setenv("STRATA_CACHE", str(tmp_path))
    _, levels = on_opengl(gl_context, constant(nits))
    scale = logic.storage_scale(constant(nits))
    for texels in levels[:-1]:
        assert np.abs(texels[..., :3].astype(float) * scale / nits - 1).max() < 1e-3
