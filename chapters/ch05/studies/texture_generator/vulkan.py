"""The study texture-generator on Vulkan: a storage image, its layout transition to a texture, and the one back."""

from __future__ import annotations

from collections.abc import Collection
from pathlib import Path
from typing import Any

from backends.vulkan import api as vk
from backends.vulkan.barriers import barriers, image_barrier
from backends.vulkan.resources import create_image, destroy_image
from common.view.camera import View

from ...frames.vulkan_commands import Commands
from ...pipelines.compute_description import ComputeDescription
from ...pipelines.description import PipelineDescription
from ...pipelines.vulkan_descriptors import Texture
from ..stage_vulkan import Stage
from . import SHADERS, STUDY, TEXELS, KernelWork, Settings, kernel, push, texture_size


class Renderer(Stage):
    """A texture that a kernel writes, over the whole picture."""

    study = STUDY
    settings_class: type = Settings
    kernel = staticmethod(kernel)  # a fork may replace it

    def create(self) -> None:
        """Make both pipelines."""
        described = PipelineDescription(SHADERS, color="rgba8", depth=None, name="show")
        self._kernel, self._show = self.pipelines.get(
            [ComputeDescription(self.kernel(self.settings), name=self.settings.shader), described]
        )
        self._sampler = self.sampler(TEXELS, "texels")

    def create_sized(self) -> None:
        """Make the texture, and its layout transitions."""
        self.extent = texture_size(self.settings, self.size, self.device.limits.maxImageDimension2D)
        usage = (
            vk.VK_IMAGE_USAGE_STORAGE_BIT | vk.VK_IMAGE_USAGE_SAMPLED_BIT | vk.VK_IMAGE_USAGE_TRANSFER_SRC_BIT
        )
        self.image = image = create_image(self.device, "rgba8", self.extent, usage, "generated")
        self.keep_sized(image, lambda resource: destroy_image(self.device, resource))
        # Shaders can store to an image in this layout only.
        stored = Texture(image.view, None, vk.VK_IMAGE_LAYOUT_GENERAL)
        self._storing = self.set_of(self._kernel, {0: stored}, "image of the kernel", sized=True)
        sampled = Texture(image.view, self._sampler)
        self._sampling = self.set_of(self._show, {0: sampled}, "texture to show", sized=True)

        def change(before: str, after: str, discard: bool = False) -> Any:
            return barriers(image_barrier(image.handle, image.aspect, before, after, discard=discard))

        last_state = "sampled"  # after the frame before this one
        if "texture" in self.outputs:
            self._targets["texture"] = (image, "sampled")
            last_state = "copy_source"  # the stage has copied it since
        # Before the kernel overwrites it: earlier frames may still read it. Its contents are discarded.
        self._to_write = change(last_state, "storage", discard=True)
        self._to_read = change("storage", "sampled")
        self._to_read_again = change(last_state, "sampled")
        self._made_at: float | None = None

    def draw(self, commands: Commands, view: View, time: float) -> None:
        """Compute the texture if the time has changed, and show it."""
        self.work = work = KernelWork(draws=1, triangles=1)
        if time != self._made_at:
            commands.barrier(self._to_write)
            commands.begin_label("kernel")
            commands.bind_compute(self._kernel)
            commands.bind_compute_set(self._kernel, 0, self._storing)
            commands.push(self._kernel, push(time))
            commands.dispatch_over(self._kernel, self.extent)
            commands.end_label()
            commands.barrier(self._to_read)
            self._made_at, work.dispatches = time, 1
        elif "texture" in self.outputs:
            commands.barrier(self._to_read_again)
        commands.begin_label("show")
        self.begin(commands)
        commands.bind_pipeline(self._show)
        commands.bind_set(self._show, 0, self._sampling)
        commands.draw_triangle()
        self.end(commands)
        commands.end_label()

    def _exchange(self, changed: Collection[Path]) -> tuple[str, ...]:
        self._made_at = None  # another shader makes another texture
        return super()._exchange(changed)
