"""What recording costs: the chapter's own loop beside the same commands through the `vulkan` package's wrappers.

Chapter 1 records every frame anew, so that this is paid per frame; the figures are ratios within one run.
"""

from __future__ import annotations

import json
import subprocess
import sys
from collections import Counter
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from backends.vulkan import api as vk
from backends.vulkan.device import Device
from backends.vulkan.instance import Instance
from chapters.ch01.frames.vulkan import FrameSlot
from chapters.ch01.frames.vulkan_commands import Commands
from chapters.ch01.renderer import Renderer
from common.paths import ROOT
from common.scene import Image, Material
from tests.support.scenes import facing, quad_scene, texture, translated
from tests.support.timing import least_times, timed

pytestmark = pytest.mark.until(1, "indirect draws are not recorded one by one")

DRAWS = 1000
REPETITIONS = 15


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


def measured() -> tuple[float, float]:
    """Return the seconds that recording takes by the chapter's commands and through the package's wrappers.

    The device has no validation, which would cost more than what is measured.
    """
    with (
        Instance() as instance,
        Device(instance) as device,
        Renderer(scene_of_draws(), (64, 64), device=device) as renderer,
    ):
        assert renderer.render(facing()).work["draws"] == DRAWS + 1  # and the tone curve's triangle
        recording = Recording(device, renderer)
        forward = renderer.passes[0]
        log: list[tuple[str, tuple[Any, ...]]] = []
        device.fn.trace(log)
        recording.seconds(lambda: forward.record(recording.commands))
        device.fn.trace(None)
        first = next(i for i, (name, _) in enumerate(log) if name == "vkCmdBindVertexBuffers")
        last = next(i for i, (name, _) in enumerate(log) if name == "vkCmdEndRendering")
        package = through_the_package(log[first:last])
        measures = {
            "ours": lambda: recording.seconds(lambda: forward.record(recording.commands)),
            "theirs": lambda: recording.seconds(package),
        }
        least = least_times(measures, lambda least: least["ours"] <= 0.25 * least["theirs"], REPETITIONS)
        recording.close()
    return least["ours"], least["theirs"]


@pytest.mark.alone
def test_recording_costs_a_quarter_of_what_the_package_s_wrappers_cost(
    record_property: Callable[[str, object], None],
) -> None:
    """In a process of its own: where many tests have drawn, the driver takes longer for each call, on either way."""
    pytest.importorskip("vulkan", exc_type=ImportError)
    code = "import json; from tests.ch01.test_recording import measured; print(json.dumps(measured()))"
    child = subprocess.run(
        [sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=False
    )
    if "UnsupportedError" in child.stderr:
        pytest.skip(f"no Vulkan: {child.stderr.splitlines()[-1]}")
    assert child.returncode == 0, child.stderr
    ours, theirs = json.loads(child.stdout.splitlines()[-1])
    shown = f"{1e3 * ours:.2f} ms, package {1e3 * theirs:.2f} ms, ratio {ours / theirs:.3f}"
    record_property("recording 1,000 draws", shown)
    print(f"\n  1,000 draws: {shown}")
    assert ours <= 0.25 * theirs
