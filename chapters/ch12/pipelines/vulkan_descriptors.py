"""Descriptor sets of fixed content: a layout is a table of bindings, a set is that table filled once and never changed.

All sets are created before the first frame. A set must not be written while a frame in flight may read it, so data that
changes from frame to frame has one set per slot.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from backends.vulkan import api as vk
from backends.vulkan.device import Device
from backends.vulkan.resources import Buffer, Image, create_image, create_sampler, destroy_image
from common.scene import Sampler

from .vulkan_layouts import TYPES, SetLayout
from .vulkan_reflection import Binding


@dataclass(frozen=True)
class Texture:
    """An image view with the sampler that reads it, the content of one descriptor."""

    view: Any
    sampler: Any
    layout: int = vk.VK_IMAGE_LAYOUT_SHADER_READ_ONLY_OPTIMAL


@dataclass(frozen=True)
class Part:
    """A part of a buffer, from byte `offset` on."""

    buffer: Buffer
    offset: int
    size: int


@dataclass(frozen=True)
class Structure:
    """An acceleration structure that rays are traced through."""

    handle: Any


Held = Buffer | Part | Structure | Texture | Sequence[Texture]
"""The content of a binding; several textures for an array of them."""


@dataclass(frozen=True)
class Sets:
    """Descriptor sets that were created together, and their pool; they are freed together."""

    pool: Any
    handles: list[Any]


def pool_sizes(layouts: Sequence[SetLayout]) -> dict[int, int]:
    """Return the number of descriptors of each Vulkan type in all sets of these layouts together."""
    sizes: dict[int, int] = {}
    for layout in layouts:
        for binding, count in zip(layout.bindings, layout.counts, strict=True):
            kind = TYPES[binding.kind]
            sizes[kind] = sizes.get(kind, 0) + count
    return sizes


class Descriptors:
    """Sets of fixed content, created from reflected layouts (see pipelines/vulkan_reflection.py)."""

    def __init__(self, device: Device) -> None:
        self._device = device
        self._alive: list[Sets] = []
        self._unread: tuple[Image, Texture] | None = None
        self.set_count = 0
        """The number of live sets."""

    def create(self, tables: Sequence[tuple[SetLayout, Mapping[int, Held], str]]) -> Sets:
        """Create one set per (layout, content by binding number, name), from a pool of exactly that size.

        A binding without content is one that no shader reads in this scene.
        """
        sizes = pool_sizes([layout for layout, _, _ in tables])
        info = vk.new(
            "VkDescriptorPoolCreateInfo",
            maxSets=len(tables),
            pPoolSizes=[{"type": kind, "descriptorCount": count} for kind, count in sizes.items()],
        )
        pool = self._device.create("vkCreateDescriptorPool", info, f"{len(tables)} sets")
        new_sets = Sets(pool, [])
        self._alive.append(new_sets)  # before anything can fail: `close` frees the pool
        layouts = [layout.handle for layout, _, _ in tables]
        allocate = vk.new("VkDescriptorSetAllocateInfo", descriptorPool=pool, pSetLayouts=layouts)
        sets = vk.ffi.new("VkDescriptorSet[]", len(tables))
        fn = self._device.fn
        code = fn.vkAllocateDescriptorSets(self._device.handle, allocate, sets)
        vk.check(code, "vkAllocateDescriptorSets", allocate)
        new_sets.handles.extend(sets)
        self.set_count += len(tables)
        writes = []
        for handle, (layout, content, name) in zip(sets, tables, strict=True):
            self._device.name("VkDescriptorSet", handle, name)
            for binding in layout.bindings:
                if binding.number in content:
                    writes.append(self._write(handle, binding, content[binding.number]))
                elif binding.kind == "texture":
                    writes.append(self._write(handle, binding, [self._stand_in()] * binding.count))
        fn.vkUpdateDescriptorSets(
            self._device.handle, len(writes), vk.array("VkWriteDescriptorSet", writes), 0, vk.NULL
        )
        return new_sets

    @staticmethod
    def _write(handle: Any, binding: Binding, content: Held) -> Any:
        target = {
            "dstSet": handle,
            "dstBinding": binding.number,
            "descriptorCount": binding.count,
            "descriptorType": TYPES[binding.kind],
        }
        if isinstance(content, Buffer):
            content = Part(content, 0, content.size)
        if isinstance(content, Part):
            info = {"buffer": content.buffer.handle, "offset": content.offset, "range": content.size}
            return vk.new("VkWriteDescriptorSet", pBufferInfo=[info], **target)
        if isinstance(content, Structure):
            held = vk.new(
                "VkWriteDescriptorSetAccelerationStructureKHR", pAccelerationStructures=[content.handle]
            )
            return vk.new("VkWriteDescriptorSet", pNext=held, **target)
        images = [
            {
                "sampler": descriptor.sampler,
                "imageView": descriptor.view,
                "imageLayout": descriptor.layout,
            }
            for descriptor in ([content] if isinstance(content, Texture) else content)
        ]
        return vk.new("VkWriteDescriptorSet", pImageInfo=images, **target)

    def _stand_in(self) -> Texture:
        """Return a texture for bindings that no shader reads: one texel without content, created at its first use.

        Vulkan allows such a binding to stay unwritten. Mesa 22.3's software driver copies the samplers of all bindings
        of a bound set, and crashes at a binding that was never written.
        """
        if self._unread is None:
            device, name = self._device, "never read"
            image = create_image(device, "rgba8", (1, 1), vk.VK_IMAGE_USAGE_SAMPLED_BIT, name)
            sampler = create_sampler(device, Sampler(), 1.0, name)
            self._unread = image, Texture(image.view, sampler)
        return self._unread[1]

    def destroy(self, sets: Sets) -> None:
        """Free sets; no frame in flight may use them."""
        self._alive.remove(sets)
        self.set_count -= len(sets.handles)
        self._device.destroy("VkDescriptorPool", sets.pool)

    def close(self) -> None:
        """Free pools, and with them their sets."""
        for sets in list(self._alive):
            self.destroy(sets)
        if self._unread is not None:
            image, texture = self._unread
            self._device.destroy("VkSampler", texture.sampler)
            destroy_image(self._device, image)
            self._unread = None
