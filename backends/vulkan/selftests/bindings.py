"""What the programs of the self-tests read and write: one descriptor set with textures, buffers, structures of rays."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from backends.vulkan import api as vk
from backends.vulkan.device import Device
from backends.vulkan.resources import Buffer

if TYPE_CHECKING:
    from backends.vulkan.selftests.bench import Bench


@dataclass(frozen=True)
class Texture:
    """A view and a sampler, for a combined image sampler."""

    view: Any
    sampler: Any


@dataclass(frozen=True)
class Acceleration:
    """A top-level acceleration structure."""

    handle: Any


Resource = Buffer | Texture | Acceleration | Sequence[Texture | None]
"""What is bound at 0, 1, 2, ... of set 0; a sequence is an array of textures with gaps, and must come last."""


_BINDLESS = (
    vk.VK_DESCRIPTOR_BINDING_PARTIALLY_BOUND_BIT
    | vk.VK_DESCRIPTOR_BINDING_UPDATE_AFTER_BIND_BIT
    | vk.VK_DESCRIPTOR_BINDING_VARIABLE_DESCRIPTOR_COUNT_BIT
)


def _type_of(resource: Resource) -> int:
    if isinstance(resource, Buffer):
        return int(vk.VK_DESCRIPTOR_TYPE_STORAGE_BUFFER)
    if isinstance(resource, Acceleration):
        return int(vk.VK_DESCRIPTOR_TYPE_ACCELERATION_STRUCTURE_KHR)
    return int(vk.VK_DESCRIPTOR_TYPE_COMBINED_IMAGE_SAMPLER)


def layout(bench: Bench, resources: Sequence[Resource], push: int = 0) -> tuple[Any, Any]:
    """Return (pipeline layout, descriptor set) with `resources` at the bindings 0, 1, 2, ...

    The layout also has `push` bytes of push constants for all stages.

    An array of textures is bindless: its size is variable, gaps are not written, and it may be written late.
    """
    described, flags, sizes = [], [], []
    for binding, resource in enumerate(resources):
        many = isinstance(resource, Sequence)
        count = len(resource) if isinstance(resource, Sequence) else 1
        described.append(
            {
                "binding": binding,
                "descriptorType": _type_of(resource),
                "descriptorCount": count,
                "stageFlags": vk.VK_SHADER_STAGE_ALL,
            }
        )
        flags.append(_BINDLESS if many else 0)
        sizes.append(
            {"type": _type_of(resource), "descriptorCount": count},
        )
    late = any(flags)
    set_layout = bench.make(
        "vkCreateDescriptorSetLayout",
        "VkDescriptorSetLayoutCreateInfo",
        pNext=vk.new("VkDescriptorSetLayoutBindingFlagsCreateInfo", pBindingFlags=flags) if late else None,
        flags=vk.VK_DESCRIPTOR_SET_LAYOUT_CREATE_UPDATE_AFTER_BIND_POOL_BIT if late else 0,
        pBindings=described or None,
    )
    pool = bench.make(
        "vkCreateDescriptorPool",
        "VkDescriptorPoolCreateInfo",
        flags=vk.VK_DESCRIPTOR_POOL_CREATE_UPDATE_AFTER_BIND_BIT if late else 0,
        maxSets=1,
        pPoolSizes=sizes or [{"type": vk.VK_DESCRIPTOR_TYPE_SAMPLER, "descriptorCount": 1}],
    )
    counts = None
    if late:
        counts = vk.new(
            "VkDescriptorSetVariableDescriptorCountAllocateInfo",
            pDescriptorCounts=[sizes[-1]["descriptorCount"]],
        )
    allocate = vk.new(
        "VkDescriptorSetAllocateInfo", pNext=counts, descriptorPool=pool, pSetLayouts=[set_layout]
    )
    out = vk.ffi.new("VkDescriptorSet[1]")
    code = bench.fn.vkAllocateDescriptorSets(bench.device.handle, allocate, out)
    vk.check(code, "vkAllocateDescriptorSets", allocate)
    for binding, resource in enumerate(resources):
        if not isinstance(resource, Sequence):
            write(bench.device, out[0], binding, 0, resource)
    layout = bench.make(
        "vkCreatePipelineLayout",
        "VkPipelineLayoutCreateInfo",
        pSetLayouts=[set_layout],
        pPushConstantRanges=[{"stageFlags": vk.VK_SHADER_STAGE_ALL, "size": push}] if push else None,
    )
    return layout, out[0]


def write(
    device: Device, target: Any, binding: int, index: int, resource: Buffer | Texture | Acceleration
) -> None:
    """Write one descriptor of a set."""
    fields: dict[str, Any] = {}
    if isinstance(resource, Buffer):
        fields["pBufferInfo"] = [{"buffer": resource.handle, "range": vk.VK_WHOLE_SIZE}]
    elif isinstance(resource, Texture):
        layout = vk.VK_IMAGE_LAYOUT_SHADER_READ_ONLY_OPTIMAL
        fields["pImageInfo"] = [
            {"sampler": resource.sampler, "imageView": resource.view, "imageLayout": layout}
        ]
    else:
        fields["descriptorCount"] = 1
        fields["pNext"] = vk.new(
            "VkWriteDescriptorSetAccelerationStructureKHR", pAccelerationStructures=[resource.handle]
        )
    writes = vk.array(
        "VkWriteDescriptorSet",
        [
            {
                "dstSet": target,
                "dstBinding": binding,
                "dstArrayElement": index,
                "descriptorType": _type_of(resource),
                **fields,
            }
        ],
    )
    device.fn.vkUpdateDescriptorSets(device.handle, 1, writes, 0, vk.NULL)
