"""What recording costs: the chapter's own loop beside the same commands through the `vulkan` package's wrappers.

Chapter 1 records every frame anew, so that this is paid per frame; the figures are ratios within one run.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest

from backends.vulkan import api as vk
from backends.vulkan.device import Device
from backends.vulkan.instance import Instance
from chapters.ch01.frames.vulkan import FrameSlot
from chapters.ch01.frames.vulkan_commands import Commands
from chapters.ch01.renderer import Renderer
from common.errors import UnsupportedError
from common.scene import Image, Material
from tests.support.scenes import facing, quad_scene, texture, translated
from tests.support.timing import least_times, timed

pytestmark = pytest.mark.until(1, "indirect draws are not recorded one by one")

DRAWS = 1000
REPETITIONS = 15


@pytest.fixture
def plain_device() -> Iterator[Device]:
    """A device without validation, which would cost more than what is measured."""
    try:
        with Instance() as instance, Device(instance) as device:
            yield device
    except UnsupportedError as error:
        pytest.skip(f"no Vulkan: {error}")


def scene_of_draws() -> Any:
    """Return squares that blend, two materials in turns: each needs a descriptor set, push constants and a draw."""
    white = Image("white", np.full((2, 2, 4), 255, np.uint8))
    glass = Material(base_color=(1, 1, 1, 0.5), alpha_mode="blend", base_color_texture=texture(), unlit=True)
    return quad_scene(
        matrices=tuple(translated(z=-0.001 * index) for index in range(DRAWS)),
        images=(white,),
        materials=(glass, glass),
        instance_materials=(0, 1) * (DRAWS // 2),
    )


class Recording:
    """An open command buffer inside the forward pass's rendering, begun anew for every repetition."""

    def __init__(self, device: Device, renderer: Renderer) -> None:
        self._fn, self._device, self._renderer = device.fn, device, renderer
        self.slot = FrameSlot(device, 0)
        self.commands = Commands(device)
        self._begin = vk.new("VkCommandBufferBeginInfo")

    def seconds(self, record: Callable[[], object]) -> float:
        """Return the time that `record` took of this thread."""
        vk.check(self._fn.vkResetCommandPool(self._device.handle, self.slot.pool, 0), "vkResetCommandPool")
        vk.check(self._fn.vkBeginCommandBuffer(self.slot.commands, self._begin), "vkBeginCommandBuffer")
        self.commands.begin(self.slot)
        self.commands.begin_rendering(self._renderer._forward_rendering)
        took = timed(record)()
        self.commands.end_rendering()
        vk.check(self._fn.vkEndCommandBuffer(self.slot.commands), "vkEndCommandBuffer")
        return took

    def close(self) -> None:
        self._device.destroy("VkCommandPool", self.slot.pool)
        self._device.destroy("VkFence", self.slot.fence)


def through_the_package(calls: list[tuple[str, tuple[Any, ...]]]) -> Callable[[], None]:
    """Return a function that makes the same `calls` through the package's wrappers, as its examples write them:
    handles and constants at hand, and a list where the API wants an array."""
    vulkan = pytest.importorskip("vulkan", exc_type=ImportError)
    theirs: Any = vulkan._vulkan.ffi

    def converted(value: Any) -> Any:
        if not isinstance(value, vk.ffi.CData):
            return value
        ctype = vk.ffi.typeof(value)
        if ctype.kind == "array":
            return [converted(item) for item in value]
        if value == vk.NULL:
            return None
        return theirs.cast(ctype.cname, int(vk.ffi.cast("uintptr_t", value)))

    # All that a program could keep from frame to frame is made here, outside the time.
    order = [(getattr(vulkan, name), tuple(map(converted, arguments))) for name, arguments in calls]
    count = Counter(name for name, _ in calls)
    assert count["vkCmdDrawIndexed"] == count["vkCmdPushConstants"] == DRAWS
    assert count["vkCmdBindDescriptorSets"] >= DRAWS

    def record() -> None:
        for call, arguments in order:
            call(*arguments)

    return record


@pytest.mark.alone
def test_recording_costs_a_quarter_of_what_the_package_s_wrappers_cost(
    plain_device: Device, record_property: Callable[[str, object], None]
) -> None:
    with Renderer(scene_of_draws(), (64, 64), device=plain_device) as renderer:
        assert renderer.render(facing()).work["draws"] == DRAWS + 1  # and the tone curve's triangle
        recording = Recording(plain_device, renderer)
        forward = renderer.passes[0]
        log: list[tuple[str, tuple[Any, ...]]] = []
        plain_device.fn.trace(log)
        recording.seconds(lambda: forward.record(recording.commands))
        plain_device.fn.trace(None)
        first = next(i for i, (name, _) in enumerate(log) if name == "vkCmdBindVertexBuffers")
        last = next(i for i, (name, _) in enumerate(log) if name == "vkCmdEndRendering")
        package = through_the_package(log[first:last])
        measures = {
            "ours": lambda: recording.seconds(lambda: forward.record(recording.commands)),
            "theirs": lambda: recording.seconds(package),
        }
        least = least_times(measures, lambda least: least["ours"] <= 0.25 * least["theirs"], REPETITIONS)
        recording.close()
    ours, theirs, ratio = 1e3 * least["ours"], 1e3 * least["theirs"], least["ours"] / least["theirs"]
    record_property("recording 1,000 draws", f"{ours:.2f} ms, package {theirs:.2f} ms, ratio {ratio:.3f}")
    print(f"\n  1,000 draws: {ours:.2f} ms, through the package {theirs:.2f} ms: {ratio:.3f}")
    assert ratio <= 0.25
