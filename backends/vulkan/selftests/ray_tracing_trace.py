"""Self-test: a ray-tracing pipeline with hit and miss shaders hits the triangles that rays hit in float64."""

from __future__ import annotations

import numpy as np

from backends.vulkan.barriers import barriers
from backends.vulkan.selftests import bindings, ray_tables, triangles
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
    rays, world = triangles.rays(), triangles.build(bench)
    output = bench.output(2 * triangles.RAYS)
    layout, bound = bindings.layout(bench, [world, bench.input(rays), output])
    traced = ray_tables.pipeline(
        bench,
        pStages=bench.stages(SOURCES, ["GL_EXT_ray_tracing"]),
        pGroups=[
            {**ray_tables.GENERAL, "generalShader": 0},
            {**ray_tables.GENERAL, "generalShader": 1},
            {**ray_tables.TRIANGLES, "closestHitShader": 2},
        ],
        layout=layout,
    )
    regions = ray_tables.tables(bench, traced, 3)
    with bench.submit() as commands:
        ray_tables.trace(bench, traced, layout, bound, regions, (32, triangles.RAYS // 32), commands)
        bench.fn.vkCmdPipelineBarrier2(commands, barriers(memory=EVERYTHING))
    return triangles.compare(bench.read(output, np.uint32).reshape(-1, 2), rays)
