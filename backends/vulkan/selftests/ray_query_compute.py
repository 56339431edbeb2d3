"""Self-test: rays traced in a compute shader hit the triangles that they hit in float64."""

from __future__ import annotations

import numpy as np

from backends.vulkan.selftests import triangles
from backends.vulkan.selftests.bench import Bench

TRACE = """
layout(set = 0, binding = 0) uniform accelerationStructureEXT world;
layout(std430, set = 0, binding = 1) readonly buffer A { vec4 rays[]; };
uvec2 trace(uint i) {
    rayQueryEXT query;
    rayQueryInitializeEXT(
        query, world, gl_RayFlagsOpaqueEXT, 0xFF, rays[2 * i].xyz, 0.0, rays[2 * i + 1].xyz, 100.0);
    while (rayQueryProceedEXT(query)) {}
    if (rayQueryGetIntersectionTypeEXT(query, true) == gl_RayQueryCommittedIntersectionNoneEXT) return uvec2(0);
    uint hit = 1u + 4u * uint(rayQueryGetIntersectionInstanceCustomIndexEXT(query, true))
        + uint(rayQueryGetIntersectionPrimitiveIndexEXT(query, true));
    return uvec2(hit, floatBitsToUint(rayQueryGetIntersectionTEXT(query, true)));
}
"""
SOURCE = (
    "layout(local_size_x = 64) in;"
    + TRACE
    + """
layout(std430, set = 0, binding = 2) writeonly buffer B { uvec2 b[]; };
void main() { b[gl_GlobalInvocationID.x] = trace(gl_GlobalInvocationID.x); }
"""
)
EXTENSIONS = ("GL_EXT_ray_query",)


def run(bench: Bench) -> str:
    """Return what was wrong, or ""."""
    rays, world = triangles.rays(), triangles.build(bench)
    output = bench.output(2 * triangles.RAYS)
    bench.dispatch(SOURCE, [world, bench.input(rays), output], triangles.RAYS // 64, EXTENSIONS)
    return triangles.compare(bench.read(output, np.uint32).reshape(-1, 2), rays)
