"""Ray pipelines of the self-tests: how one is created, and its binding table of one record for each region."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from backends.vulkan import api as vk
from backends.vulkan.resources import buffer_address
from backends.vulkan.selftests.bench import Bench

NONE = dict.fromkeys(
    ("generalShader", "closestHitShader", "anyHitShader", "intersectionShader"), vk.VK_SHADER_UNUSED_KHR
)
GENERAL = {"type": vk.VK_RAY_TRACING_SHADER_GROUP_TYPE_GENERAL_KHR, **NONE}
TRIANGLES = {"type": vk.VK_RAY_TRACING_SHADER_GROUP_TYPE_TRIANGLES_HIT_GROUP_KHR, **NONE}


def pipeline(bench: Bench, **fields: Any) -> Any:
    """Return a ray pipeline without recursion, from members of its VkRayTracingPipelineCreateInfoKHR."""
    device = bench.device
    infos = vk.array("VkRayTracingPipelineCreateInfoKHR", [{"maxPipelineRayRecursionDepth": 1, **fields}])
    out = vk.ffi.new("VkPipeline[1]")
    code = bench.fn.vkCreateRayTracingPipelinesKHR(device.handle, vk.NULL, vk.NULL, 1, infos, vk.NULL, out)
    vk.check(code, "vkCreateRayTracingPipelinesKHR", infos)
    device.adopt("VkPipeline", out[0], "selftest")
    bench.at_end(device.destroy, "VkPipeline", out[0])
    return out[0]


def tables(bench: Bench, of: Any, groups: int) -> Sequence[Any]:
    """Return the regions of generation, miss, hit and callable of a pipeline whose groups are one of each, or fewer."""
    device, fn = bench.device, bench.fn
    limits = vk.new("VkPhysicalDeviceRayTracingPipelinePropertiesKHR")
    outer = vk.new("VkPhysicalDeviceProperties2", pNext=limits)
    device.instance.fn.vkGetPhysicalDeviceProperties2(device.physical.handle, outer)
    size, base = int(limits.shaderGroupHandleSize), int(limits.shaderGroupBaseAlignment)
    handles = np.zeros((groups, size), np.uint8)
    code = fn.vkGetRayTracingShaderGroupHandlesKHR(
        device.handle, of, 0, groups, handles.nbytes, vk.ffi.from_buffer(handles)
    )
    vk.check(code, "vkGetRayTracingShaderGroupHandlesKHR")
    # One record per table, each at a multiple of the base alignment; the buffer's own address may be none.
    stride = -(-size // base) * base
    table = bench.input(
        np.zeros((groups + 1) * stride + base, np.uint8), vk.VK_BUFFER_USAGE_SHADER_BINDING_TABLE_BIT_KHR
    )
    address = buffer_address(device, table)
    start = -address % base
    for number, handle in enumerate(handles):
        table.mapped[start + number * stride :][:size] = handle

    def region(number: int) -> object:
        where = address + start + number * stride
        return vk.new("VkStridedDeviceAddressRegionKHR", deviceAddress=where, stride=stride, size=stride)

    empty = vk.new("VkStridedDeviceAddressRegionKHR")
    return [region(number) if number < groups else empty for number in range(4)]


def trace(
    bench: Bench,
    of: Any,
    layout: Any,
    bound: Any,
    regions: Sequence[Any],
    extent: tuple[int, int],
    commands: Any,
) -> None:
    """Record a trace with one descriptor set."""
    point, fn = vk.VK_PIPELINE_BIND_POINT_RAY_TRACING_KHR, bench.fn
    fn.vkCmdBindPipeline(commands, point, of)
    sets = vk.array("VkDescriptorSet", [bound])
    fn.vkCmdBindDescriptorSets(commands, point, layout, 0, 1, sets, 0, vk.NULL)
    fn.vkCmdTraceRaysKHR(commands, *regions, *extent, 1)
