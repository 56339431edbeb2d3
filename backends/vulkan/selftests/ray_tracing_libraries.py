"""Self-test: a ray-tracing pipeline that is linked from libraries reads its push constants."""

from __future__ import annotations

import numpy as np

from backends.vulkan import api as vk
from backends.vulkan.barriers import barriers
from backends.vulkan.selftests import bindings, ray_tables
from backends.vulkan.selftests.bench import EVERYTHING, Bench, differ

SOURCES = {
    "rgen": """
layout(std430, set = 0, binding = 0) writeonly buffer B { uint b[]; };
PUSH(uvec4, pushed)
void main() { b[gl_LaunchIDEXT.x] = pushed.x + gl_LaunchIDEXT.x; }
""",
    "rmiss": """
layout(location = 0) rayPayloadInEXT uint result;
void main() { result = 0; }
""",
}
COUNT, EXTENSION = 8, "VK_KHR_pipeline_library"


def run(bench: Bench) -> str:
    """Return what was wrong, or ""."""
    if EXTENSION not in bench.device.extensions:
        return f"the device has no {EXTENSION}"
    output = bench.output(COUNT)
    layout, bound = bindings.layout(bench, [output], push=16)
    interface = {"maxPipelineRayPayloadSize": 4, "maxPipelineRayHitAttributeSize": 8}
    group = {**ray_tables.GENERAL, "generalShader": 0}
    libraries = [
        ray_tables.pipeline(
            bench,
            flags=vk.VK_PIPELINE_CREATE_LIBRARY_BIT_KHR,
            pStages=[stage],
            pGroups=[group],
            pLibraryInterface=interface,
            layout=layout,
        )
        for stage in bench.stages(SOURCES, ["GL_EXT_ray_tracing"])
    ]
    linked = ray_tables.pipeline(
        bench,
        pLibraryInfo={"pLibraries": libraries, "libraryCount": len(libraries)},
        pLibraryInterface=interface,
        layout=layout,
    )
    regions = ray_tables.tables(bench, linked, 2)
    values = vk.array("uint32_t", [77, 0, 0, 0])
    with bench.submit() as commands:
        bench.fn.vkCmdPushConstants(commands, layout, vk.VK_SHADER_STAGE_ALL, 0, 16, values)
        ray_tables.trace(bench, linked, layout, bound, regions, (COUNT, 1), commands)
        bench.fn.vkCmdPipelineBarrier2(commands, barriers(memory=EVERYTHING))
    return differ("words", bench.read(output, np.uint32), np.arange(77, 77 + COUNT, dtype=np.uint32))
