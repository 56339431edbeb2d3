"""Compute pipelines on Vulkan: one shader, and none of a graphics pipeline's other state.

`Pipelines` keeps them beside graphics pipelines. The bindings and push constants of a kernel are read from its SPIR-V,
equal descriptions share a pipeline, the cache on disk contains it, and an edit of a file rebuilds it.

    pipeline = pipelines.get([ComputeDescription("blur.comp")])[0]
    commands.bind_compute(pipeline)
    commands.dispatch_over(pipeline, (width, height))
"""

from __future__ import annotations

from typing import Any

from backends.vulkan import api as vk
from backends.vulkan.device import Device

from ..frames.dispatches import GroupLimits, check_group
from .compute_description import ComputeDescription
from .spirv.shared_memory import shared_bytes
from .vulkan_cache import PipelineCache
from .vulkan_reflection import Stage


def group_of(stage: Stage) -> tuple[int, int, int]:
    """Return the invocations of a work group along each axis, specialization included."""
    return stage.module.entries[0].local_size or (1, 1, 1)


def subgroup_size(device: Device) -> int:
    """Return how many invocations of a device run together, as its driver prefers it."""
    subgroup = vk.new("VkPhysicalDeviceSubgroupProperties")
    properties = vk.new("VkPhysicalDeviceProperties2", pNext=subgroup)
    device.instance.fn.vkGetPhysicalDeviceProperties2(device.physical.handle, properties)
    return int(subgroup.subgroupSize)


def build_compute(
    device: Device,
    described: ComputeDescription,
    stage: Stage,
    specialization: Any,
    layout: Any,
    cache: PipelineCache | None,
) -> Any:
    """Return the VkPipeline; raises ShaderError for work groups that the device cannot run."""
    device_has = device.limits
    limits = GroupLimits(
        int(device_has.maxComputeWorkGroupInvocations),
        [*device_has.maxComputeWorkGroupSize],
        int(device_has.maxComputeSharedMemorySize),
    )
    shared = shared_bytes(stage.code, dict(stage.constants))
    files = stage.source.paths if stage.source else frozenset()
    check_group(described.shader, group_of(stage), shared, limits, files)
    module = device.create(
        "vkCreateShaderModule",
        vk.new("VkShaderModuleCreateInfo", codeSize=len(stage.code), pCode=stage.code),
        described.shader,
    )
    try:
        shader = vk.new(
            "VkPipelineShaderStageCreateInfo",
            stage=vk.VK_SHADER_STAGE_COMPUTE_BIT,
            module=module,
            pName="main",
            pSpecializationInfo=specialization,
        )
        info = vk.new("VkComputePipelineCreateInfo", stage=shader, layout=layout)
        infos = vk.array("VkComputePipelineCreateInfo", [info])
        kept = cache.handle if cache else vk.NULL
        return device.create_pipelines("vkCreateComputePipelines", infos, [described.title], kept)[0]
    finally:
        device.destroy("VkShaderModule", module)
