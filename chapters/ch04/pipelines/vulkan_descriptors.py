"""Descriptor sets of fixed content: a layout is a table of bindings, a set is that table filled once and never changed.

All sets are made before the first frame. A set that a frame in flight may read must not be written, so whatever
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
    """An image view with the sampler that reads it, as a descriptor holds them."""

    view: Any
    sampler: Any
    layout: int = vk.VK_IMAGE_LAYOUT_SHADER_READ_ONLY_OPTIMAL


Held = Buffer | Texture | Sequence[Texture]
"""What a binding holds; several textures where it is an array of them."""


@dataclass(frozen=True)
class Sets:
    """Descriptor sets that were made together, and the pool that they go back to together."""

    pool: Any
    handles: list[Any]


def pool_sizes(layouts: Sequence[SetLayout]) -> dict[int, int]:
    """Return how many descriptors of each Vulkan type sets of the given layouts need together."""
    sizes: dict[int, int] = {}
    for layout in layouts:
        for binding, count in zip(layout.bindings, layout.counts, strict=True):
            kind = TYPES[binding.kind]
            sizes[kind] = sizes.get(kind, 0) + count
    return sizes


class Descriptors:
    """Sets of fixed content, made from layouts that shaders told (see pipelines/vulkan_reflection.py)."""

    def __init__(self, device: Device) -> None:
        self._device = device
        self._alive: list[Sets] = []
        self._unread: tuple[Image, Texture] | None = None

    @property
    def set_count(self) -> int:
        """Sets that exist."""
        return sum(len(sets.handles) for sets in self._alive)

    def create(self, wanted: Sequence[tuple[SetLayout, Mapping[int, Held], str]]) -> Sets:
        """Make one set per (layout, what each binding number holds, name), from a pool of exactly that size.

        A binding that holds nothing is one that no shader reads in this scene.
        """
        sizes = pool_sizes([layout for layout, _, _ in wanted])
        info = vk.new(
            "VkDescriptorPoolCreateInfo",
            maxSets=len(wanted),
            pPoolSizes=[{"type": kind, "descriptorCount": count} for kind, count in sizes.items()],
        )
        pool = self._device.create("vkCreateDescriptorPool", info, f"{len(wanted)} sets")
        made = Sets(pool, [])
        self._alive.append(made)  # before anything can fail: `close` frees the pool
        layouts = [layout.handle for layout, _, _ in wanted]
        allocate = vk.new("VkDescriptorSetAllocateInfo", descriptorPool=pool, pSetLayouts=layouts)
        sets = vk.ffi.new("VkDescriptorSet[]", len(wanted))
        fn = self._device.fn
        code = fn.vkAllocateDescriptorSets(self._device.handle, allocate, sets)
        vk.check(code, "vkAllocateDescriptorSets", allocate)
        made.handles.extend(sets)
        writes = []
        for handle, (layout, held, name) in zip(sets, wanted, strict=True):
            self._device.name("VkDescriptorSet", handle, name)
            for binding in layout.bindings:
                if binding.number in held:
                    writes.append(self._write(handle, binding, held[binding.number]))
                elif binding.kind == "texture":
                    writes.append(self._write(handle, binding, [self._stand_in()] * binding.count))
        fn.vkUpdateDescriptorSets(
            self._device.handle, len(writes), vk.array("VkWriteDescriptorSet", writes), 0, vk.NULL
        )
        return made

    @staticmethod
    def _write(handle: Any, binding: Binding, held: Held) -> Any:
        target = {
            "dstSet": handle,
            "dstBinding": binding.number,
            "descriptorCount": binding.count,
            "descriptorType": TYPES[binding.kind],
        }
        if isinstance(held, Buffer):
            return vk.new(
                "VkWriteDescriptorSet", pBufferInfo=[{"buffer": held.handle, "range": held.size}], **target
            )
        images = [
            {
                "sampler": one.sampler,
                "imageView": one.view,
                "imageLayout": one.layout,
            }
            for one in ([held] if isinstance(held, Texture) else held)
        ]
        return vk.new("VkWriteDescriptorSet", pImageInfo=images, **target)

    def _stand_in(self) -> Texture:
        """Return a texture for bindings that no shader reads: one texel without content, made at its first use.

        Vulkan lets such a binding stay unwritten. Mesa 22.3's software driver copies the samplers of all bindings of a
        bound set, and crashes where one was never written.
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
