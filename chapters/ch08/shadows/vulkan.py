"""The memory of shadows on Vulkan: images, barriers around each round, and the set of the kernel."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from backends.vulkan import api as vk
from backends.vulkan.barriers import barriers, image_barrier, transition
from backends.vulkan.once import submit_once
from backends.vulkan.resources import Buffer, Image, create_view
from common.scene import Sampler

from ..frames.frame import SLOTS
from ..frames.vulkan_commands import Commands, Rendering
from ..graph.sync.vulkan import layout_of
from ..pipelines.description import Built
from ..pipelines.vulkan_descriptors import Texture
from .memory import ShadowMemory as _ShadowMemory

_NEAREST = Sampler("nearest", "nearest", None, "clamp", "clamp")


@dataclass
class _Target:
    image: Image
    layers: list[Rendering]
    to_draw: Any
    to_read: Any


class ShadowMemory(_ShadowMemory):
    """Buffers and images of the renderer's resources, which free them."""

    def _create(self, size: tuple[int, int]) -> None:
        backend = self._backend
        resources, device = backend.resources, backend.device
        usage = vk.VK_BUFFER_USAGE_STORAGE_BUFFER_BIT
        self._handles = [
            resources.buffer(self.layout.size, usage, "upload", f"shadows, slot {slot}") for slot in range(SLOTS)
        ]
        self.blocks: list[Buffer] = [resources.buffers.get(handle) for handle in self._handles]
        stored = vk.VK_IMAGE_USAGE_STORAGE_BIT | vk.VK_IMAGE_USAGE_TRANSFER_SRC_BIT
        self._images = [resources.image("r32f", size, stored, "shadow pages")]
        self.pages: Image = resources.images.get(self._images[0])
        with submit_once(device) as commands:
            transition(device, commands, self.pages, "undefined", "storage")
        self._sets: dict[int, Any] = {}
        self._alive: list[Any] = []

    @property
    def held_pages(self) -> Texture:
        """The pages as shaders load them and store to them."""
        return Texture(self.pages.view, vk.NULL, layout_of("general", self.pages))

    def _create_target(self, size: int, layers: int) -> _Target:
        resources, device = self._backend.resources, self._backend.device
        usage = vk.VK_IMAGE_USAGE_DEPTH_STENCIL_ATTACHMENT_BIT | vk.VK_IMAGE_USAGE_SAMPLED_BIT
        name = f"shadow faces of {size}"
        handle = resources.image("d32f", (size, size), usage, name, layers=layers, array=True)
        self._images.append(handle)
        image = resources.images.get(handle)
        views = [create_view(device, image, "d32f", layer=layer, layers=1) for layer in range(layers)]
        renderings = [Rendering((size, size), None, replace(image, view=view), None, 0.0) for view in views]
        change = partial(image_barrier, image.handle, image.aspect)
        return _Target(
            image,
            renderings,
            barriers(change("sampled", "depth", discard=True)),
            barriers(change("depth", "sampled")),
        )

    # --- recording ---

    def begin_round(self, commands: Commands, size: int) -> None:
        """Make the target of a size ready to be drawn to, after the last copy out of it."""
        commands.barrier(self._targets[size].to_draw)

    def begin_face(self, commands: Commands, size: int, layer: int) -> None:
        """Begin drawing to a layer of the target, after clearing it to the far plane."""
        commands.begin_rendering(self._targets[size].layers[layer])

    def end_face(self, commands: Commands) -> None:
        """End drawing."""
        commands.end_rendering()

    def store(self, commands: Any, kernel: Built, size: int, first: int, count: int) -> None:
        """Copy layers into the pages."""
        target = self._targets[size]
        commands.barrier(target.to_read)
        commands.bind_compute(kernel)
        commands.bind_compute_set(kernel, 0, self._set(kernel, size, commands.slot.index))
        commands.push(kernel, np.array([[first, 0, 0, 0]], np.uint32))
        commands.dispatch_over(kernel, (size, size, count))

    def _set(self, kernel: Built, size: int, slot: int) -> Any:
        """Return the set of the kernel for a target, made for both slots at first use."""
        if (size, slot) not in self._sets:
            sampler = self._backend.resources.sampler(_NEAREST, 1.0)
            drawn = Texture(self._targets[size].image.view, sampler)
            tables = [
                (kernel.sets[0], {0: block, 1: drawn, 2: self.held_pages}, f"shadow faces of {size}, slot {number}")
                for number, block in enumerate(self.blocks)
            ]
            sets = self._backend.descriptors.create(tables)
            self._alive.append(sets)
            for number, handle in enumerate(sets.handles):
                self._sets[size, number] = vk.array("VkDescriptorSet", [handle])
        return self._sets[size, slot]

    def close(self) -> None:
        """Give everything up; frames in flight may still use it."""
        resources, descriptors = self._backend.resources, self._backend.descriptors
        for sets in self._alive:
            resources.defer(partial(descriptors.destroy, sets))
        for handle in self._handles:
            resources.destroy_buffer(handle)
        for handle in self._images:
            resources.destroy_image(handle)
        self._alive, self._handles, self._images = [], [], []
