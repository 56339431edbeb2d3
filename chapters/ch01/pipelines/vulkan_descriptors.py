"""Descriptor sets: a layout is a table of bindings, a set is that table filled once and never changed.

All sets are created before the first frame. A set must not be written while a frame in flight may read it, so data that
changes from frame to frame has one set per slot.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from backends.vulkan import api as vk
from backends.vulkan.device import Device
from backends.vulkan.resources import Buffer

from .description import Binding

_TYPES = {
    "uniform": vk.VK_DESCRIPTOR_TYPE_UNIFORM_BUFFER,
    "storage": vk.VK_DESCRIPTOR_TYPE_STORAGE_BUFFER,
    "texture": vk.VK_DESCRIPTOR_TYPE_COMBINED_IMAGE_SAMPLER,
}
_STAGES = {
    "all": vk.VK_SHADER_STAGE_VERTEX_BIT | vk.VK_SHADER_STAGE_FRAGMENT_BIT,
    "fragment": vk.VK_SHADER_STAGE_FRAGMENT_BIT,
}


@dataclass(frozen=True)
class Texture:
    """An image view with the sampler that reads it, the content of one descriptor."""

    view: Any
    sampler: Any


@dataclass(frozen=True)
class Sets:
    """Descriptor sets that were created together, and their pool; they are freed together."""

    pool: Any
    handles: list[Any]


def pool_sizes(sets: Sequence[Sequence[Binding]]) -> dict[int, int]:
    """Return the number of descriptors of each Vulkan type in all sets together."""
    sizes: dict[int, int] = {}
    for bindings in sets:
        for binding in bindings:
            kind = _TYPES[binding.kind]
            sizes[kind] = sizes.get(kind, 0) + 1
    return sizes


class Descriptors:
    """Set layouts (one per distinct table) and the sets created from them."""

    def __init__(self, device: Device) -> None:
        self._device = device
        self._layouts: dict[tuple[Binding, ...], Any] = {}
        self._alive: list[Sets] = []

    @property
    def set_count(self) -> int:
        """The number of live sets."""
        return sum(len(sets.handles) for sets in self._alive)

    def layout(self, bindings: Sequence[Binding]) -> Any:
        """Return the layout for a table of bindings, created at its first use."""
        key = tuple(bindings)
        if key not in self._layouts:
            items = [
                {
                    "binding": binding.number,
                    "descriptorType": _TYPES[binding.kind],
                    "descriptorCount": 1,
                    "stageFlags": _STAGES[binding.stages],
                }
                for binding in key
            ]
            info = vk.new("VkDescriptorSetLayoutCreateInfo", pBindings=items)
            name = ", ".join(f"{binding.number}: {binding.kind}" for binding in key)
            self._layouts[key] = self._device.create("vkCreateDescriptorSetLayout", info, name)
        return self._layouts[key]

    def create(self, tables: Sequence[tuple[Sequence[Binding], dict[int, Buffer | Texture], str]]) -> Sets:
        """Create one set per (bindings, content by binding number, name), from a pool of exactly that size."""
        sizes = pool_sizes([bindings for bindings, _, _ in tables])
        info = vk.new(
            "VkDescriptorPoolCreateInfo",
            maxSets=len(tables),
            pPoolSizes=[{"type": kind, "descriptorCount": count} for kind, count in sizes.items()],
        )
        pool = self._device.create("vkCreateDescriptorPool", info, f"{len(tables)} sets")
        new_sets = Sets(pool, [])
        self._alive.append(new_sets)  # before anything can fail: `close` frees the pool
        layouts = [self.layout(bindings) for bindings, _, _ in tables]
        allocate = vk.new("VkDescriptorSetAllocateInfo", descriptorPool=pool, pSetLayouts=layouts)
        sets = vk.ffi.new("VkDescriptorSet[]", len(tables))
        fn = self._device.fn
        code = fn.vkAllocateDescriptorSets(self._device.handle, allocate, sets)
        vk.check(code, "vkAllocateDescriptorSets", allocate)
        new_sets.handles.extend(sets)
        writes = []
        for handle, (bindings, content, name) in zip(sets, tables, strict=True):
            self._device.name("VkDescriptorSet", handle, name)
            for binding in bindings:
                writes.append(self._write(handle, binding, content[binding.number]))
        fn.vkUpdateDescriptorSets(
            self._device.handle, len(writes), vk.array("VkWriteDescriptorSet", writes), 0, vk.NULL
        )
        return new_sets

    @staticmethod
    def _write(handle: Any, binding: Binding, content: Buffer | Texture) -> Any:
        target = {
            "dstSet": handle,
            "dstBinding": binding.number,
            "descriptorCount": 1,
            "descriptorType": _TYPES[binding.kind],
        }
        if isinstance(content, Buffer):
            return vk.new(
                "VkWriteDescriptorSet",
                pBufferInfo=[{"buffer": content.handle, "range": content.size}],
                **target,
            )
        image = {
            "sampler": content.sampler,
            "imageView": content.view,
            "imageLayout": vk.VK_IMAGE_LAYOUT_SHADER_READ_ONLY_OPTIMAL,
        }
        return vk.new("VkWriteDescriptorSet", pImageInfo=[image], **target)

    def destroy(self, sets: Sets) -> None:
        """Free sets; no frame in flight may use them."""
        self._alive.remove(sets)
        self._device.destroy("VkDescriptorPool", sets.pool)

    def close(self) -> None:
        """Free pools (and with them their sets) and layouts."""
        for sets in list(self._alive):
            self.destroy(sets)
        for layout in self._layouts.values():
            self._device.destroy("VkDescriptorSetLayout", layout)
