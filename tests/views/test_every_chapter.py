"""What each chapter keeps of the views and of waiting, cheaply: a tiny frame, and the numbers that calls get."""

from __future__ import annotations

from importlib import import_module

import numpy as np
import pytest

import chapters
from backends.vulkan import api as vk
from common.images import palette
from tests.support.scenes import facing, quad_scene

CHAPTERS = pytest.mark.parametrize("number", chapters.available())


@CHAPTERS
@pytest.mark.variants("vulkan")
def test_a_device_with_geometry_shaders_draws_numbers_of_triangles(vulkan_device, number):
    """That feature lets fragments ask for their triangle, whatever else is said of it."""
    features = vk.ffi.new("VkPhysicalDeviceFeatures *")
    vulkan_device.instance.fn.vkGetPhysicalDeviceFeatures(vulkan_device.physical.handle, features)
    if not features.geometryShader:
        pytest.skip("the device has no geometryShader")
    settings = chapters.settings_class(number)(view="triangle-id")
    with chapters.open(
        number,
        "vulkan",
        scene=quad_scene(),
        size=(8, 8),
        settings=settings,
        device=vulkan_device,
        outputs="color_linear",
    ) as renderer:
        stored = renderer.render(facing()).image("color_linear")
    colors = stored[2:6, 2:6, :3].reshape(-1, 1, 3)
    truth = np.stack([palette.id_color(palette.part_id(0, part)) for part in (0, 1)])
    off = np.abs(colors - truth).max(axis=-1)
    assert off.min(axis=1).max() < 1e-3 and {*off.argmin(axis=1).tolist()} == {0, 1}, (
        "both triangles are seen"
    )


@CHAPTERS
def test_a_wait_without_end_has_the_number_for_it(number):
    """UINT64_MAX (Vulkan specification, vkWaitForFences): less is nanoseconds, after which the wait fails."""
    assert import_module(f"{chapters.package_of(number)}.frames.vulkan").FOREVER == 0xFFFF_FFFF_FFFF_FFFF
