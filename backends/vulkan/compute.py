"""Compute kernels that run once: a pipeline with a table of bindings, and a descriptor set for every dispatch.

For what is made while loading, for tests and tools; what a frame dispatches has sets of its own, made ahead.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from backends.shader_text import ShaderSource
from backends.vulkan import api as vk
from backends.vulkan.device import Device
from backends.vulkan.resources import Buffer
from backends.vulkan.shaders.compiler import compile_shader

Kind = Literal["texture", "image", "storage"]

_TYPES: dict[Kind, int] = {
    "texture": vk.VK_DESCRIPTOR_TYPE_COMBINED_IMAGE_SAMPLER,
    "image": vk.VK_DESCRIPTOR_TYPE_STORAGE_IMAGE,
    "storage": vk.VK_DESCRIPTOR_TYPE_STORAGE_BUFFER,
}


@dataclass(frozen=True)
class Sampled:
    """A view in the state 'sampled' and the sampler that reads it; or, without one, a view in the state 'storage'."""

    view: Any
    sampler: Any = None


class Kernel:
    """The compute pipeline of `source`, whose set 0 has `bindings`, numbered in order, for up to `dispatches` uses."""

    def __init__(
        self,
        device: Device,
        source: ShaderSource,
        bindings: Sequence[Kind],
        push_size: int = 0,
        dispatches: int = 1,
    ) -> None:
        code = compile_shader(source)
        self._device, self._kinds = device, tuple(bindings)
        stage, name = vk.VK_SHADER_STAGE_COMPUTE_BIT, source.name
        items = [
            {"binding": number, "descriptorType": _TYPES[kind], "descriptorCount": 1, "stageFlags": stage}
            for number, kind in enumerate(bindings)
        ]
        info = vk.new("VkDescriptorSetLayoutCreateInfo", pBindings=items)
        self._set_layout = device.create("vkCreateDescriptorSetLayout", info, name)
        pushes = [{"stageFlags": stage, "size": push_size}] if push_size else None
        info = vk.new(
            "VkPipelineLayoutCreateInfo", pSetLayouts=[self._set_layout], pPushConstantRanges=pushes
        )
        self._layout = device.create("vkCreatePipelineLayout", info, name)
        info = vk.new("VkShaderModuleCreateInfo", codeSize=len(code), pCode=code)
        module = device.create("vkCreateShaderModule", info, name)
        shader = vk.new("VkPipelineShaderStageCreateInfo", stage=stage, module=module, pName="main")
        described = vk.new("VkComputePipelineCreateInfo", stage=shader, layout=self._layout)
        infos = vk.array("VkComputePipelineCreateInfo", [described])
        self._pipeline = device.create_pipelines("vkCreateComputePipelines", infos, [name])[0]
        device.destroy("VkShaderModule", module)
        sizes = [
            {"type": _TYPES[kind], "descriptorCount": dispatches * self._kinds.count(kind)}
            for kind in sorted(set(self._kinds))
        ]
        info = vk.new("VkDescriptorPoolCreateInfo", maxSets=dispatches, pPoolSizes=sizes)
        self._pool = device.create("vkCreateDescriptorPool", info, name)

    def record(
        self,
        commands: Any,
        held: Sequence[Buffer | Sampled],
        groups: tuple[int, int, int],
        push: np.ndarray | None = None,
    ) -> None:
        """Record one dispatch of `groups` work groups; `held` fills the bindings. Barriers are the caller's."""
        fn, device = self._device.fn, self._device.handle
        info = vk.new(
            "VkDescriptorSetAllocateInfo", descriptorPool=self._pool, pSetLayouts=[self._set_layout]
        )
        sets = vk.ffi.new("VkDescriptorSet[1]")
        vk.check(fn.vkAllocateDescriptorSets(device, info, sets), "vkAllocateDescriptorSets")
        writes = [
            self._write(sets[0], number, kind, resource)
            for number, (kind, resource) in enumerate(zip(self._kinds, held, strict=True))
        ]
        fn.vkUpdateDescriptorSets(device, len(writes), vk.array("VkWriteDescriptorSet", writes), 0, vk.NULL)
        point = vk.VK_PIPELINE_BIND_POINT_COMPUTE
        fn.vkCmdBindPipeline(commands, point, self._pipeline)
        fn.vkCmdBindDescriptorSets(commands, point, self._layout, 0, 1, sets, 0, vk.NULL)
        if push is not None:
            raw = np.ascontiguousarray(push).view(np.uint8).reshape(-1)
            stage = vk.VK_SHADER_STAGE_COMPUTE_BIT
            fn.vkCmdPushConstants(commands, self._layout, stage, 0, raw.size, vk.ffi.from_buffer(raw))
        fn.vkCmdDispatch(commands, *groups)

    @staticmethod
    def _write(target: Any, number: int, kind: Kind, held: Buffer | Sampled) -> Any:
        common = {
            "dstSet": target,
            "dstBinding": number,
            "descriptorCount": 1,
            "descriptorType": _TYPES[kind],
        }
        if isinstance(held, Buffer):
            return vk.new(
                "VkWriteDescriptorSet", pBufferInfo=[{"buffer": held.handle, "range": held.size}], **common
            )
        layout = (
            vk.VK_IMAGE_LAYOUT_SHADER_READ_ONLY_OPTIMAL if kind == "texture" else vk.VK_IMAGE_LAYOUT_GENERAL
        )
        image = {"sampler": held.sampler, "imageView": held.view, "imageLayout": layout}
        return vk.new("VkWriteDescriptorSet", pImageInfo=[image], **common)

    def close(self) -> None:
        """Free the pipeline and its sets, when nothing submitted uses them."""
        self._device.destroy("VkDescriptorPool", self._pool)
        self._device.destroy("VkPipeline", self._pipeline)
        self._device.destroy("VkPipelineLayout", self._layout)
        self._device.destroy("VkDescriptorSetLayout", self._set_layout)
