"""In which order objects are drawn: the nearest first, so that what is hidden fails its depth test unshaded."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
import pytest

from backends.vulkan import api as vk
from chapters.ch01.renderer import Renderer
from chapters.ch01.scene.draw_lists import DrawLists
from chapters.ch01.settings import Settings
from common.numerics.transforms import pose_looking_at
from common.scene import Light, Material
from common.view.camera import Orthographic, View
from tests.support import gl_functions
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


class Pushed(list[int]):
    """A log that reads the first word of all push constants when they are pushed."""

    def append(self, call: Any) -> None:
        name, arguments = call
        if name == "vkCmdPushConstants":
            super().append(int(vk.ffi.cast("uint32_t *", arguments[-1])[0]))


def drawn(device: Any, renderer: Any, view: View) -> list[int]:
    """Return the instances of one frame's draws, in the order in which they were recorded."""
    if renderer.capabilities.backend == "gl":
        table, found = renderer._data.push, []

        def note(name: str, arguments: tuple[Any, ...]) -> None:
            if name == "glBindBufferRange" and arguments[2] == table.buffer.handle:
                found.append(arguments[3] // table.stride)

        with gl_functions.noted(device, note):
            renderer.render(view)
        return found
    pushed = Pushed()
    device.fn.trace(pushed)
    renderer.render(view)
    device.fn.trace(None)
    return pushed


def test_the_nearest_is_drawn_first_from_every_side(vulkan_device):
    with Renderer(scene_in_depth(), SIZE, device=vulkan_device) as renderer:
        from_front = np.argsort(-np.array(DEPTHS)).tolist()
        assert drawn(vulkan_device, renderer, seen_from(8.0)) == from_front
        assert drawn(vulkan_device, renderer, seen_from(-8.0)) == from_front[::-1]
        assert drawn(vulkan_device, renderer, seen_from(8.0)) == from_front


@pytest.mark.feature("device/command-buffers")
@pytest.mark.variants("vulkan", "without-all", "gl")
def test_the_keys_of_recorded_draws_strictly_rise(chapter: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    """A draw's key: what is solid, then masks, then glass; in each the nearest first, but glass the farthest."""
    rng = np.random.default_rng(7)
    kinds, depths = rng.permutation(np.arange(12) % 3), rng.permutation(np.linspace(-3, 3, 12))
    scene = quad_scene(
        materials=(
            Material(double_sided=True),
            Material(double_sided=True, alpha_mode="mask"),
            Material(double_sided=True, alpha_mode="blend", base_color=(1.0, 1.0, 1.0, 0.5)),
        ),
        matrices=tuple(translated(z=z) for z in depths),
        instance_materials=tuple(kinds.tolist()),
        lights=(Light("directional", node=0, intensity=3.0),),
    )

    def rise(side: float) -> bool:
        with chapter.open(scene, SIZE) as renderer:
            order = drawn(chapter.device, renderer, seen_from(side))
        assert sorted(order) == list(range(12))
        away = -np.sign(side) * depths
        keys = [(int(kinds[i]), float(away[i] if kinds[i] < 2 else -away[i])) for i in order]
        return all(first < second for first, second in pairwise(keys))

    assert rise(8.0) and rise(-8.0)
    monkeypatch.setattr(DrawLists, "nearest_first", lambda self, depth: self)
    assert not rise(8.0), "the order of the scene is another"


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
