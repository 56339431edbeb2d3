"""The study textured-mesh on Vulkan: vertices, indices and texels are uploaded once, and a draw names them."""

from __future__ import annotations

from typing import Any

import numpy as np

from backends.vulkan import api as vk
from backends.vulkan.resources import (
    create_buffer,
    create_image,
    create_sampler,
    destroy_buffer,
    destroy_image,
)
from backends.vulkan.upload import Uploader
from common.scene import Sampler, Scene
from common.scene.primitive import alone, primitive_of
from common.view.camera import View

from ...frames.frame import SLOTS
from ...frames.vulkan_commands import Commands
from ...pipelines.description import Binding, PipelineDescription
from ...pipelines.vulkan_descriptors import Texture
from ...scene.geometry import stream_offsets
from ...scene.textures import texels
from ..stage_vulkan import Stage
from . import STREAMS, STUDY, UNIFORM_BYTES, Settings, uniforms

BINDINGS = (Binding(0, "uniform"), Binding(1, "texture", "fragment"))


class Renderer(Stage):
    """One object of a scene, turning, with the picture of its base colour."""

    study = STUDY
    has_depth = True
    settings_class: type = Settings
    folder = "textured_mesh"
    streams = STREAMS
    uniform_bytes = UNIFORM_BYTES

    def choose(self, scene: Scene) -> Scene:
        """Return the one object that is drawn."""
        return alone(scene, self.settings.instance)

    def uniforms(self, view: View, time: float) -> np.ndarray:
        """Return what the shaders read in this frame."""
        return uniforms(self.scene, self._primitive, view, time, self.size[0] / self.size[1])

    def create(self) -> None:
        """Upload the object, and make what draws it."""
        self._buffers: list[Any] = []
        self._primitive = primitive_of(self.scene)
        # Memory that the GPU reads fast is memory that the CPU often cannot reach. So data goes through a buffer that
        # both reach, and from there by a copy that the GPU makes; `Uploader` keeps that buffer. It waits at its end.
        with Uploader(self.device) as uploader:
            self._upload_geometry(uploader)
            self._upload_texture(uploader)
        usage = vk.VK_BUFFER_USAGE_UNIFORM_BUFFER_BIT
        self._uniforms = [
            self._buffer(self.uniform_bytes, usage, "upload", f"uniforms, slot {slot}")
            for slot in range(SLOTS)
        ]
        texture = Texture(self._image.view, self._sampler)
        sets = self.descriptors.create(
            [(BINDINGS, {0: buffer, 1: texture}, f"set of {buffer.name}") for buffer in self._uniforms]
        )
        self._sets = [vk.array("VkDescriptorSet", [handle]) for handle in sets.handles]
        described = PipelineDescription(
            shaders=(f"studies/{self.folder}/mesh.vert", f"studies/{self.folder}/mesh.frag"),
            sets=(BINDINGS,),
            streams=tuple(self.streams.values()),
            color="rgba8",
            name=self.study.title,
        )
        self._pipeline = self.pipelines.get([described])[0]

    def _buffer(self, size: int, usage: int, use: Any, name: str) -> Any:
        self._buffers.append(create_buffer(self.device, size, usage, use, name))
        return self._buffers[-1]

    def _upload_geometry(self, uploader: Uploader) -> None:
        """Put all streams and the indices into one buffer, each at its own offset."""
        arrays = {name: getattr(self._primitive, name) for name in (*self.streams, "indices")}
        offsets, size = stream_offsets({name: array.nbytes for name, array in arrays.items()})
        use = vk.VK_BUFFER_USAGE_VERTEX_BUFFER_BIT | vk.VK_BUFFER_USAGE_INDEX_BUFFER_BIT
        buffer = self._buffer(size, use | vk.VK_BUFFER_USAGE_TRANSFER_DST_BIT, "device", "geometry")
        for name, array in arrays.items():
            uploader.buffer(buffer, array, offsets[name])
        handles = vk.array("VkBuffer", [buffer.handle])
        self._bound = (
            [
                (location, handles, vk.array("VkDeviceSize", [offsets[name]]))
                for name, (location, _) in self.streams.items()
            ],
            buffer.handle,
            offsets["indices"],
        )

    def _upload_texture(self, uploader: Uploader) -> None:
        """Upload the picture and let the GPU make its mip levels, each a quarter of the one before."""
        texture = self._primitive.material.base_color_texture
        chain = texels.texels_of(self.scene, "base_color", texels.key_of("base_color", texture))
        height, width = chain.pixels.shape[:2]
        usage = vk.VK_IMAGE_USAGE_SAMPLED_BIT | vk.VK_IMAGE_USAGE_TRANSFER_DST_BIT
        if chain.levels > 1:
            usage |= vk.VK_IMAGE_USAGE_STORAGE_BIT  # a compute shader writes the levels
        self._image = create_image(
            self.device,
            chain.format,
            (width, height),
            usage,
            chain.name,
            levels=chain.levels,
            view_format=chain.view_format,
        )
        uploader.image(self._image, chain.pixels, srgb=chain.srgb)
        how = texture.sampler if texture is not None else Sampler()
        self._sampler = create_sampler(self.device, how, 1.0, chain.name)

    def draw(self, commands: Commands, view: View, time: float) -> None:
        """Write this frame's uniforms, bind what was made, and draw by index."""
        slot, count = commands.slot.index, len(self._primitive.indices)
        self._uniforms[slot].view(np.float32)[:] = self.uniforms(view, time)
        self.begin(commands)
        commands.bind_pipeline(self._pipeline)
        commands.bind_set(self._pipeline, 0, self._sets[slot])
        commands.bind_geometry(*self._bound)
        # A vertex that six triangles share is in memory once, and often shaded once.
        self.device.fn.vkCmdDrawIndexed(commands.handle, count, 1, 0, 0, 0)
        self.end(commands)
        self.work.draws, self.work.triangles = 1, count // 3

    def destroy(self) -> None:
        """Free buffers, image and sampler."""
        for buffer in getattr(self, "_buffers", ()):
            destroy_buffer(self.device, buffer)
        if hasattr(self, "_image"):
            destroy_image(self.device, self._image)
        if hasattr(self, "_sampler"):
            self.device.destroy("VkSampler", self._sampler)
