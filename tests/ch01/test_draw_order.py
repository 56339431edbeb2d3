"""In which order objects are drawn: the nearest first, so that what is hidden fails its depth test unshaded."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from backends.vulkan import api as vk
from chapters.ch01.logic.draw_lists import DrawLists
from chapters.ch01.renderer import Renderer
from chapters.ch01.settings import Settings
from common.camera import Orthographic, View
from common.scene import Light, Material
from common.transforms import pose_looking_at
from tests.support.scenes import quad_scene, translated

pytestmark = pytest.mark.until(
    1, "lists that the GPU reads keep the order of the scene, whatever the camera does"
)

SIZE = (32, 32)
DEPTHS = (-3.0, 1.0, -1.0, 2.5, 0.0)


def scene_in_depth() -> Any:
    """Return squares one behind the other, in no order, each a little to the side of the last; one light."""
    matrices = tuple(translated(0.1 * i, 0.05 * i, z) for i, z in enumerate(DEPTHS))
    material = Material(base_color=(0.7, 0.5, 0.3, 1.0), double_sided=True)
    return quad_scene(material, matrices=matrices, lights=(Light("directional", node=0, intensity=3.0),))


def seen_from(z: float) -> View:
    """Return a view along the z axis from either side."""
    return View(pose_looking_at((0.0, 0.0, z), (0.0, 0.0, 0.0)), Orthographic(1.5, 0.1, 20.0))


def drawn(device: Any, renderer: Renderer, view: View) -> list[int]:
    """Return the instances of one frame's draws, in the order in which they were recorded."""
    log: list[tuple[str, tuple[Any, ...]]] = []
    device.fn.trace(log)
    renderer.render(view)
    device.fn.trace(None)
    pushes = [arguments[-1] for name, arguments in log if name == "vkCmdPushConstants"]
    return [int(vk.ffi.cast("uint32_t *", pointer)[0]) for pointer in pushes]


def test_the_nearest_is_drawn_first_from_every_side(vulkan_device):
    with Renderer(scene_in_depth(), SIZE, device=vulkan_device) as renderer:
        from_front = np.argsort(-np.array(DEPTHS)).tolist()
        assert drawn(vulkan_device, renderer, seen_from(8.0)) == from_front
        assert drawn(vulkan_device, renderer, seen_from(-8.0)) == from_front[::-1]
        assert drawn(vulkan_device, renderer, seen_from(8.0)) == from_front


@pytest.mark.parametrize("output", ["color_linear", "instance_id", "depth"])
def test_the_order_does_not_change_a_bit_of_the_picture(vulkan_device, monkeypatch, output):
    def picture() -> np.ndarray:
        settings = Settings(color_format="rgba32f")
        with Renderer(scene_in_depth(), SIZE, settings, outputs={output}, device=vulkan_device) as renderer:
            return renderer.render(seen_from(8.0)).image(output)

    sorted_by_depth = picture()
    monkeypatch.setattr(DrawLists, "nearest_first", lambda self, depth: self)
    assert np.array_equal(picture(), sorted_by_depth)
    assert len(np.unique(sorted_by_depth)) > 2
