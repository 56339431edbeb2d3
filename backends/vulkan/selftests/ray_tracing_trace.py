"""Self-test: a ray-tracing pipeline with hit and miss shaders hits the triangles that rays hit in float64."""

from __future__ import annotations

import numpy as np

from backends.vulkan import api as vk
from backends.vulkan.barriers import barriers
from backends.vulkan.resources import buffer_address
from backends.vulkan.selftests import bindings, triangles
from backends.vulkan.selftests.bench import EVERYTHING, Bench

SOURCES = {
    "rgen": """
layout(set = 0, binding = 0) uniform accelerationStructureEXT world;
layout(std430, set = 0, binding = 1) readonly buffer A { vec4 rays[]; };
layout(std430, set = 0, binding = 2) writeonly buffer B { uvec2 b[]; };
layout(location = 0) rayPayloadEXT uvec2 result;
void main() {
    uint i = gl_LaunchIDEXT.y * gl_LaunchSizeEXT.x + gl_LaunchIDEXT.x;
    result = uvec2(77);
    traceRayEXT(
        world, gl_RayFlagsOpaqueEXT, 0xFF, 0, 0, 0, rays[2 * i].xyz, 0.0, rays[2 * i + 1].xyz, 100.0, 0);
    b[i] = result;
}
""",
    "rmiss": """
layout(location = 0) rayPayloadInEXT uvec2 result;
void main() { result = uvec2(0); }
""",
    "rchit": """
layout(location = 0) rayPayloadInEXT uvec2 result;
void main() {
    result = uvec2(
        1u + 4u * uint(gl_InstanceCustomIndexEXT) + uint(gl_PrimitiveID), floatBitsToUint(gl_HitTEXT));
}
""",
}


def run(bench: Bench) -> str:
    """Return what was wrong, or ""."""
    fn, device = bench.fn, bench.device
    rays, world = triangles.rays(), triangles.build(bench)
    output = bench.output(2 * triangles.RAYS)
    layout, bound = bindings.layout(bench, [world, bench.input(rays), output])
    stages = bench.stages(SOURCES, ["GL_EXT_ray_tracing"])
    unused = vk.VK_SHADER_UNUSED_KHR
    none = dict.fromkeys(("generalShader", "closestHitShader", "anyHitShader", "intersectionShader"), unused)
    general = {"type": vk.VK_RAY_TRACING_SHADER_GROUP_TYPE_GENERAL_KHR, **none}
    hits = {"type": vk.VK_RAY_TRACING_SHADER_GROUP_TYPE_TRIANGLES_HIT_GROUP_KHR, **none}
    groups = [
        {**general, "generalShader": 0},
        {**general, "generalShader": 1},
        {**hits, "closestHitShader": 2},
    ]
    infos = vk.array(
        "VkRayTracingPipelineCreateInfoKHR",
        [{"pStages": stages, "pGroups": groups, "maxPipelineRayRecursionDepth": 1, "layout": layout}],
    )
    out = vk.ffi.new("VkPipeline[1]")
    code = fn.vkCreateRayTracingPipelinesKHR(device.handle, vk.NULL, vk.NULL, 1, infos, vk.NULL, out)
    vk.check(code, "vkCreateRayTracingPipelinesKHR", infos)
    device.adopt("VkPipeline", out[0], "selftest")
    bench.at_end(device.destroy, "VkPipeline", out[0])

    limits = vk.new("VkPhysicalDeviceRayTracingPipelinePropertiesKHR")
    outer = vk.new("VkPhysicalDeviceProperties2", pNext=limits)
    device.instance.fn.vkGetPhysicalDeviceProperties2(device.physical.handle, outer)
    size, base = int(limits.shaderGroupHandleSize), int(limits.shaderGroupBaseAlignment)
    handles = np.zeros((3, size), np.uint8)
    code = fn.vkGetRayTracingShaderGroupHandlesKHR(
        device.handle, out[0], 0, 3, handles.nbytes, vk.ffi.from_buffer(handles)
    )
    vk.check(code, "vkGetRayTracingShaderGroupHandlesKHR")
    # One record per table, each at a multiple of the base alignment; the buffer's own address may be none.
    stride = -(-size // base) * base
    table = bench.input(
        np.zeros(4 * stride + base, np.uint8), vk.VK_BUFFER_USAGE_SHADER_BINDING_TABLE_BIT_KHR
    )
    address = buffer_address(device, table)
    start = -address % base
    for number, handle in enumerate(handles):
        table.mapped[start + number * stride :][:size] = handle

    def region(number: int) -> object:
        where = address + start + number * stride
        return vk.new("VkStridedDeviceAddressRegionKHR", deviceAddress=where, stride=stride, size=stride)

    tables = [region(0), region(1), region(2), vk.new("VkStridedDeviceAddressRegionKHR")]
    point = vk.VK_PIPELINE_BIND_POINT_RAY_TRACING_KHR
    with bench.submit() as commands:
        fn.vkCmdBindPipeline(commands, point, out[0])
        sets = vk.array("VkDescriptorSet", [bound])
        fn.vkCmdBindDescriptorSets(commands, point, layout, 0, 1, sets, 0, vk.NULL)
        fn.vkCmdTraceRaysKHR(commands, *tables, 32, triangles.RAYS // 32, 1)
        fn.vkCmdPipelineBarrier2(commands, barriers(memory=EVERYTHING))
    return triangles.compare(bench.read(output, np.uint32).reshape(-1, 2), rays)
