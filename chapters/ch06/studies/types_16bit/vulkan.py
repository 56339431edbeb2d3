"""The study types-16bit on Vulkan: the same kernel with 16-bit types or with words, by what the device has."""

from __future__ import annotations

import numpy as np

from backends.vulkan import api as vk
from backends.vulkan.barriers import barriers
from backends.vulkan.device import Device
from common.view.camera import View

from ...frames.vulkan_commands import Commands
from ...pipelines.compute_description import ComputeDescription
from ...pipelines.description import PipelineDescription
from ..stage_vulkan import Stage
from . import (
    KERNEL,
    SHADERS,
    STUDY,
    NumberWork,
    Settings,
    bytes_of,
    decoded,
    defines,
    encoded,
    halves,
    integers,
    pairs_of,
    plan_of,
    push,
    way_of,
)

WRITTEN = (vk.VK_PIPELINE_STAGE_2_COMPUTE_SHADER_BIT, vk.VK_ACCESS_2_SHADER_STORAGE_WRITE_BIT)
DRAWN = (vk.VK_PIPELINE_STAGE_2_FRAGMENT_SHADER_BIT, vk.VK_ACCESS_2_SHADER_STORAGE_READ_BIT)


def rounds_to_nearest(device: Device) -> bool:
    """Return whether shaders may ask that 16-bit floats are rounded to the nearest."""
    controls = vk.new("VkPhysicalDeviceVulkan12Properties")
    properties = vk.new("VkPhysicalDeviceProperties2", pNext=controls)
    device.instance.fn.vkGetPhysicalDeviceProperties2(device.physical.handle, properties)
    return bool(controls.shaderRoundingModeRTEFloat16)


class Renderer(Stage):
    """A kernel with numbers of 16 bits."""

    study = STUDY
    settings_class: type = Settings
    integers = staticmethod(integers)  # a fork may replace both
    halves = staticmethod(halves)

    def create(self) -> None:
        """Upload the numbers, and make room for the results."""
        settings = self.settings
        self.plan = plan_of(self.capabilities, self.without)
        self.way = way = way_of(settings, self.plan)
        self.inputs = [
            self.filled(encoded(numbers, way), ["storage"], name)
            for numbers, name in ((self.integers(settings), "x"), (self.halves(settings), "h"))
        ]
        self.written = [self.empty(bytes_of(settings, way), ["storage"], name) for name in ("y", "g")]
        macros = defines(settings, way, way == "types" and rounds_to_nearest(self.device))
        self._kernel, self._show = self.pipelines.get(
            [
                ComputeDescription(KERNEL, macros, name=way),
                PipelineDescription(SHADERS, macros, color="rgba8", depth=None, name="show"),
            ]
        )
        held = dict(enumerate([*self.inputs, *self.written]))
        self._computing = self.set_of(self._kernel, held, "numbers of the kernel")
        self._drawing = self.set_of(self._show, held, "numbers to show")
        self._before = barriers(memory=(*DRAWN, *WRITTEN))  # the kernel waits for the draw of the last frame
        self._behind = barriers(memory=(*WRITTEN, *DRAWN))  # the draw sees the writes

    def draw(self, commands: Commands, view: View, time: float) -> None:
        """Compute and show."""
        size = sum(buffer.size for buffer in (*self.inputs, *self.written))
        self.work = NumberWork(draws=1, triangles=1, dispatches=1, bytes=size)
        constants = push(self.settings, time)
        commands.barrier(self._before)
        commands.begin_label("kernel")
        commands.bind_compute(self._kernel)
        commands.bind_compute_set(self._kernel, 0, self._computing)
        commands.push(self._kernel, constants)
        commands.dispatch_over(self._kernel, (pairs_of(self.settings),))
        commands.end_label()
        commands.barrier(self._behind)
        commands.begin_label("show")
        self.begin(commands)
        commands.bind_pipeline(self._show)
        commands.bind_set(self._show, 0, self._drawing)
        commands.push(self._show, constants)
        commands.draw_triangle()
        self.end(commands)
        commands.end_label()

    def results(self) -> tuple[np.ndarray, np.ndarray]:
        """Return y (count,) int16 and g (count,) float16 of the last frame."""
        y, g = (self.download(buffer, WRITTEN) for buffer in self.written)
        return decoded(y, np.int16, self.settings, self.way), decoded(g, np.float16, self.settings, self.way)
