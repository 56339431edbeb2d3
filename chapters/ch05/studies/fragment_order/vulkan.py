"""The study fragment-order on Vulkan: a counter that is reset, a draw that writes a list, and one that reads it."""

from __future__ import annotations

import numpy as np

from backends.vulkan import api as vk
from backends.vulkan.barriers import barriers, image_barrier
from backends.vulkan.driver import features as vf
from common.errors import UnsupportedError
from common.view.camera import View

from ...frames.vulkan_commands import Commands, Rendering
from ...pipelines.description import PipelineDescription
from ..stage_vulkan import Stage
from . import COVER, POINTS, STUDY, VERTICES, OrderWork, Settings, places, push, shown

NEEDED = vf.Requirement(bits=((vf.CORE, "fragmentStoresAndAtomics"),))

READ, WRITE = vk.VK_ACCESS_2_SHADER_STORAGE_READ_BIT, vk.VK_ACCESS_2_SHADER_STORAGE_WRITE_BIT
FRAGMENTS, POINTED = vk.VK_PIPELINE_STAGE_2_FRAGMENT_SHADER_BIT, vk.VK_PIPELINE_STAGE_2_VERTEX_SHADER_BIT
RESET = vk.VK_PIPELINE_STAGE_2_ALL_TRANSFER_BIT


class Renderer(Stage):
    """The fragments of one draw, in the order in which they came."""

    study = STUDY
    settings_class: type = Settings

    def create(self) -> None:
        """Make both pipelines and the counter."""
        missing = self.device.physical.lacks(NEEDED)
        if missing:
            raise UnsupportedError(
                f"The study fragment-order has fragments write to buffers: {missing}; try --backend gl."
            )
        quad = (("QUAD", int(self.settings.shape == "quad")),)
        self._cover, self._points = self.pipelines.get(
            [
                PipelineDescription(COVER, quad, color="rgba8", depth=None, name="number"),
                PipelineDescription(POINTS, color="rgba8", depth=None, name="points"),
            ]
        )
        self._count = self.empty(4, ["storage"], "counter")
        # The draw of the frame before may still read the list, and the counter has the last value of that frame.
        self._before_reset = barriers(
            memory=(POINTED, READ, RESET | FRAGMENTS, vk.VK_ACCESS_2_TRANSFER_WRITE_BIT | WRITE)
        )
        self._after_reset = barriers(
            memory=(RESET, vk.VK_ACCESS_2_TRANSFER_WRITE_BIT, FRAGMENTS, READ | WRITE)
        )

    def create_sized(self) -> None:
        """Make the list, with room for each pixel, and the barrier between the two draws."""
        self.capacity = self.size[0] * self.size[1]
        self._nodes = self.empty(4 * self.capacity, ["storage"], "list of fragments", sized=True)
        self._numbering = self.set_of(
            self._cover, {0: self._nodes, 1: self._count}, "list and counter", sized=True
        )
        self._drawing = self.set_of(self._points, {0: self._nodes}, "list", sized=True)
        picture = self.picture
        self._before_points = barriers(
            image_barrier(picture.handle, picture.aspect, "color", "color"),
            memory=(FRAGMENTS, WRITE, POINTED, READ),
        )
        self._going_on = Rendering(self.size, picture, None)

    def draw(self, commands: Commands, view: View, time: float) -> None:
        """Reset the counter, let the fragments of one draw number themselves, and draw the first of them."""
        count = shown(self.settings, time, self.capacity)
        vertices = VERTICES[self.settings.shape]
        self.work = OrderWork(draws=1 + bool(count), triangles=vertices // 3 + count, points=count)
        fn, numbers = self.device.fn, push(self.size, self.capacity)
        commands.barrier(self._before_reset)
        commands.begin_label("reset")
        fn.vkCmdFillBuffer(commands.handle, self._count.handle, 0, 4, 0)
        commands.end_label()
        commands.barrier(self._after_reset)
        commands.begin_label("number")
        self.begin(commands)
        commands.bind_pipeline(self._cover)
        commands.bind_set(self._cover, 0, self._numbering)
        commands.push(self._cover, numbers)
        fn.vkCmdDraw(commands.handle, vertices, 1, 0, 0)
        self.end(commands)
        commands.end_label()
        commands.barrier(self._before_points)
        commands.begin_label("points")
        commands.begin_rendering(self._going_on)
        if count:
            commands.bind_pipeline(self._points)
            commands.bind_set(self._points, 0, self._drawing)
            commands.push(self._points, numbers)
            fn.vkCmdDraw(commands.handle, 3 * count, 1, 0, 0)
        commands.end_rendering()
        commands.end_label()

    def order(self) -> tuple[int, np.ndarray]:
        """Return how many numbers the last frame gave out, and (N, 2) the pixels that got them: x and y."""
        written = (FRAGMENTS, WRITE)
        count = int(self.download(self._count, written).view(np.uint32)[0])
        return count, places(self.download(self._nodes, written).view(np.uint32))
