"""Set layouts and pipeline layouts, created from the signatures that `pipelines.vulkan_reflection` reads in shaders.

A signature does not contain the length of an unsized array: it is the program's capacity, or less by the limits of the
device. Such an array is filled while frames run, and never as a whole. So its set can be written while it is bound
(update after bind) and may have gaps (partially bound).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from backends.vulkan import api as vk
from backends.vulkan.device import Device
from backends.vulkan.driver import features as vf
from common.errors import ShaderError, UnsupportedError

from .spirv.declared import Kind
from .vulkan_reflection import STAGES, Binding, Signature

CAPACITY = 4096
"""Descriptors in an unsized array, unless the program sets another number or the device allows fewer."""

_RESERVED = 64  # descriptors of each limit, reserved for the sets without unsized arrays

_MESH = STAGES["task"] | STAGES["mesh"]
_DRAWS_OR_COMPUTES = vk.VK_SHADER_STAGE_ALL_GRAPHICS | vk.VK_SHADER_STAGE_COMPUTE_BIT
_RAYS = sum(bit for name, bit in STAGES.items() if name.startswith("r"))

TYPES: dict[Kind, int] = {
    "uniform": vk.VK_DESCRIPTOR_TYPE_UNIFORM_BUFFER,
    "dynamic uniform": vk.VK_DESCRIPTOR_TYPE_UNIFORM_BUFFER_DYNAMIC,
    "storage": vk.VK_DESCRIPTOR_TYPE_STORAGE_BUFFER,
    "dynamic storage": vk.VK_DESCRIPTOR_TYPE_STORAGE_BUFFER_DYNAMIC,
    "texture": vk.VK_DESCRIPTOR_TYPE_COMBINED_IMAGE_SAMPLER,
    "sampled image": vk.VK_DESCRIPTOR_TYPE_SAMPLED_IMAGE,
    "sampler": vk.VK_DESCRIPTOR_TYPE_SAMPLER,
    "image": vk.VK_DESCRIPTOR_TYPE_STORAGE_IMAGE,
    "uniform texels": vk.VK_DESCRIPTOR_TYPE_UNIFORM_TEXEL_BUFFER,
    "storage texels": vk.VK_DESCRIPTOR_TYPE_STORAGE_TEXEL_BUFFER,
    "input attachment": vk.VK_DESCRIPTOR_TYPE_INPUT_ATTACHMENT,
    "acceleration structure": vk.VK_DESCRIPTOR_TYPE_ACCELERATION_STRUCTURE_KHR,
}
"""The VkDescriptorType of each kind of binding."""

# The limits on unsized arrays of each kind (maxDescriptorSetUpdateAfterBind..., and the same for each stage), and the
# feature for writes to a bound set.
_OPEN: dict[Kind, tuple[tuple[str, ...], str]] = {
    "texture": (("SampledImages", "Samplers"), "SampledImage"),
    "sampled image": (("SampledImages",), "SampledImage"),
    "sampler": (("Samplers",), "SampledImage"),
    "image": (("StorageImages",), "StorageImage"),
    "uniform texels": (("SampledImages",), "UniformTexelBuffer"),
    "storage texels": (("StorageImages",), "StorageTexelBuffer"),
    "storage": (("StorageBuffers",), "StorageBuffer"),
    "uniform": (("UniformBuffers",), "UniformBuffer"),
}


@dataclass(frozen=True)
class SetLayout:
    """A VkDescriptorSetLayout with its table. `counts` are the descriptors of each binding, unsized arrays included.

    A set with a `runtime` layout is written while it is bound, and its pool allows that. If the unsized array is the
    last binding, its length is chosen when the set is allocated, up to `counts[-1]`.
    """

    handle: Any
    bindings: tuple[Binding, ...]
    runtime: bool
    counts: tuple[int, ...] = ()

    @property
    def variable(self) -> bool:
        """Whether the last binding's length is chosen when a set is allocated."""
        return bool(self.bindings) and self.bindings[-1].count == 0


class Layouts:
    """Set layouts and pipeline layouts, one for each distinct table.

    Several pipelines can share a bound set only if their set layouts are identical. So a layout is visible to all
    stages of draws and of compute, whichever stages declare a binding.
    """

    def __init__(self, device: Device, capacity: int = CAPACITY) -> None:
        self._device, self.capacity = device, capacity
        self._sets: dict[tuple[Any, ...], Any] = {}
        self._pipelines: dict[tuple[Any, ...], Any] = {}
        self._indexing = vk.new("VkPhysicalDeviceVulkan12Properties")
        properties = vk.new("VkPhysicalDeviceProperties2", pNext=self._indexing)
        device.instance.fn.vkGetPhysicalDeviceProperties2(device.physical.handle, properties)

    def sets(self, signature: Signature) -> tuple[SetLayout | None, ...]:
        """Return the layout of each set; None for a number that no stage uses."""
        stages = self.stages(signature.stages)
        return tuple(self._set(bindings, stages) if bindings else None for bindings in signature.sets)

    def pipeline(self, signature: Signature) -> tuple[Any, tuple[SetLayout | None, ...]]:
        """Return the VkPipelineLayout of a signature, and its set layouts."""
        limits = self._device.limits
        if len(signature.sets) > limits.maxBoundDescriptorSets:
            raise UnsupportedError(
                f"A shader uses set {len(signature.sets) - 1}, and this device binds {limits.maxBoundDescriptorSets}."
            )
        push = signature.push
        if push and push.offset + push.size > limits.maxPushConstantsSize:
            raise UnsupportedError(
                f"Shaders have {push.offset + push.size} bytes of push constants, and this device takes "
                f"{limits.maxPushConstantsSize}."
            )
        sets = self.sets(signature)
        stages = self.stages(signature.stages)
        handles = tuple(
            self._handle((), (), stages, False) if entry is None else entry.handle for entry in sets
        )
        key = (handles, (push.offset, push.size) if push else None, stages)
        if key not in self._pipelines:
            ranges = [{"stageFlags": stages, "offset": push.offset, "size": push.size}] if push else None
            info = vk.new(
                "VkPipelineLayoutCreateInfo", pSetLayouts=list(handles) or None, pPushConstantRanges=ranges
            )
            self._pipelines[key] = self._device.create("vkCreatePipelineLayout", info, _titled(signature))
        return self._pipelines[key], sets

    def stages(self, stages: int) -> int:
        """Return the stages to which the layouts of a pipeline with these stages are visible.

        Draws, kernels and rays share sets: a kernel and a ray read the pages and textures that draws read, too.
        """
        offered = _DRAWS_OR_COMPUTES | (_MESH if self._device.has("mesh-shader") else 0)
        return offered | (_RAYS if self._device.has("ray-tracing") else stages & _RAYS)

    def _set(self, bindings: tuple[Binding, ...], stages: int) -> SetLayout:
        runtime = any(binding.count == 0 for binding in bindings)
        if runtime and not self._device.has("bindless"):
            name = next(binding.name for binding in bindings if binding.count == 0)
            raise UnsupportedError(
                f"The array '{name}' has no end, which takes descriptor indexing, and this device is used without it."
            )
        dynamic = next((entry.name for entry in bindings if entry.kind.startswith("dynamic")), "")
        if runtime and dynamic:
            raise ShaderError(
                f"The dynamic buffer '{dynamic}' is in one set with an array without an end, which no device allows: "
                "move one of them to another set."
            )
        counts = tuple(binding.count or self._room(bindings, binding) for binding in bindings)
        return SetLayout(self._handle(bindings, counts, stages, runtime), bindings, runtime, counts)

    def _room(self, bindings: Sequence[Binding], unsized: Binding) -> int:
        """Return the length of an unsized array: the capacity, or its share of the device's limits if that is less."""
        room = self.capacity
        names = _OPEN[unsized.kind][0] if unsized.kind in _OPEN else ()
        for limit, counted in (
            *((f"maxPerStageDescriptorUpdateAfterBind{name}", name) for name in names),
            *((f"maxDescriptorSetUpdateAfterBind{name}", name) for name in names),
            ("maxPerStageUpdateAfterBindResources", ""),
            ("maxUpdateAfterBindDescriptorsInAllPools", ""),
        ):
            same = [
                entry for entry in bindings if not counted or counted in _OPEN.get(entry.kind, ((), ""))[0]
            ]
            left = getattr(self._indexing, limit) - _RESERVED - sum(entry.count for entry in same)
            room = min(room, left // sum(entry.count == 0 for entry in same))
        return max(room, 1)

    def _handle(
        self, bindings: tuple[Binding, ...], counts: tuple[int, ...], stages: int, runtime: bool
    ) -> Any:
        items = [
            (binding.number, TYPES[binding.kind], count, self._flags(bindings, binding))
            for binding, count in zip(bindings, counts, strict=True)
        ]
        key = (*items, stages)
        if key not in self._sets:
            flags = vk.new(
                "VkDescriptorSetLayoutBindingFlagsCreateInfo",
                pBindingFlags=[item[3] for item in items] or None,
            )
            info = vk.new(
                "VkDescriptorSetLayoutCreateInfo",
                pNext=flags if runtime else None,
                flags=vk.VK_DESCRIPTOR_SET_LAYOUT_CREATE_UPDATE_AFTER_BIND_POOL_BIT if runtime else 0,
                pBindings=[
                    {
                        "binding": number,
                        "descriptorType": kind,
                        "descriptorCount": count,
                        "stageFlags": stages,
                    }
                    for number, kind, count, _ in items
                ]
                or None,
            )
            name = ", ".join(f"{binding.number}: {binding.name}" for binding in bindings) or "empty set"
            self._sets[key] = self._device.create("vkCreateDescriptorSetLayout", info, name)
        return self._sets[key]

    def _flags(self, bindings: Sequence[Binding], binding: Binding) -> int:
        """Return the binding flags of one binding: an unsized array has gaps, and is written while it is bound."""
        if binding.count:
            return 0
        flags: int = vk.VK_DESCRIPTOR_BINDING_PARTIALLY_BOUND_BIT
        if binding.kind in _OPEN and self._enabled(
            f"descriptorBinding{_OPEN[binding.kind][1]}UpdateAfterBind"
        ):
            flags |= vk.VK_DESCRIPTOR_BINDING_UPDATE_AFTER_BIND_BIT
        if binding is bindings[-1]:
            flags |= vk.VK_DESCRIPTOR_BINDING_VARIABLE_DESCRIPTOR_COUNT_BIT
        return flags

    def _enabled(self, bit: str) -> bool:
        requested = (*vf.OPTIONAL["bindless"].bits, *vf.EXTRA_BITS)
        return (vf.V12, bit) in requested and (vf.V12, bit) in self._device.physical.bits

    def close(self) -> None:
        """Free every layout."""
        for layout in self._pipelines.values():
            self._device.destroy("VkPipelineLayout", layout)
        for layout in self._sets.values():
            self._device.destroy("VkDescriptorSetLayout", layout)
        self._pipelines.clear()
        self._sets.clear()


def _titled(signature: Signature) -> str:
    return ", ".join(f"set {number}" for number, entry in enumerate(signature.sets) if entry) or "no sets"
