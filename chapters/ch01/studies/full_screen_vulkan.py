"""Studies that fill the picture, on Vulkan: one triangle, uniforms for each frame in flight, perhaps a panorama."""

from __future__ import annotations

from typing import Any

import numpy as np

from backends.vulkan import api as vk
from backends.vulkan.resources import (
    Buffer,
    create_buffer,
    create_image,
    create_sampler,
    destroy_buffer,
    destroy_image,
)
from backends.vulkan.upload import Uploader
from common.view.camera import View

from ..frames.frame import SLOTS
from ..frames.vulkan_commands import Commands
from ..pipelines.description import Binding, PipelineDescription
from ..pipelines.vulkan_descriptors import Texture
from .full_screen import AROUND, texels
from .full_screen import FullScreen as AnyFullScreen
from .stage_vulkan import Stage


class FullScreen(AnyFullScreen, Stage):
    """A picture that is all fragment shader."""

    moves = False

    def create(self) -> None:
        """Make buffers, panorama, sets and the pipeline."""
        self._uniforms: list[Buffer] = []
        for slot in range(SLOTS):
            usage, name = vk.VK_BUFFER_USAGE_UNIFORM_BUFFER_BIT, f"uniforms, slot {slot}"
            self._uniforms.append(create_buffer(self.device, self.uniform_bytes, usage, "upload", name))
        bindings = [Binding(0, "uniform", "fragment")]
        around: dict[int, Any] = self._upload()
        bindings += [Binding(number, "texture", "fragment") for number in around]
        sets = self.descriptors.create(
            [(tuple(bindings), {0: buffer, **around}, f"set of {buffer.name}") for buffer in self._uniforms]
        )
        self._sets = [vk.array("VkDescriptorSet", [handle]) for handle in sets.handles]
        described = PipelineDescription(
            shaders=("post/fullscreen.vert", f"studies/{self.fragment}"),
            sets=(tuple(bindings),),
            color="rgba8",
            depth=None,
            name=self.study.title,
        )
        self._pipeline = self.pipelines.get([described])[0]

    def _upload(self) -> dict[int, Any]:
        """Return the panorama by its binding, if there is one."""
        panorama = self.panorama()
        if panorama is None:
            return {}
        pixels = texels(panorama)
        usage = vk.VK_IMAGE_USAGE_SAMPLED_BIT | vk.VK_IMAGE_USAGE_TRANSFER_DST_BIT
        size = pixels.shape[1], pixels.shape[0]
        self._image = create_image(self.device, "rgba32f", size, usage, panorama.name)
        with Uploader(self.device) as uploader:
            uploader.image(self._image, pixels)
        self._sampler = create_sampler(self.device, AROUND, 1.0, panorama.name)
        return {1: Texture(self._image.view, self._sampler)}

    def draw(self, commands: Commands, view: View, time: float) -> None:
        """Write this frame's uniforms and fill the picture."""
        slot = commands.slot.index
        self._uniforms[slot].view(np.float32)[:] = self.uniforms(view, time)
        self.begin(commands)
        commands.bind_pipeline(self._pipeline)
        commands.bind_set(self._pipeline, 0, self._sets[slot])
        self.device.fn.vkCmdDraw(commands.handle, 3, 1, 0, 0)
        self.end(commands)
        self.work.draws, self.work.triangles = 1, 1

    def destroy(self) -> None:
        """Free buffers, image and sampler."""
        for buffer in getattr(self, "_uniforms", ()):
            destroy_buffer(self.device, buffer)
        if hasattr(self, "_image"):
            destroy_image(self.device, self._image)
        if hasattr(self, "_sampler"):
            self.device.destroy("VkSampler", self._sampler)
