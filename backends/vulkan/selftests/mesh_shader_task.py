"""Self-test: task shaders choose every third square, hand the list to mesh shaders in a payload, and launch those."""

from __future__ import annotations

import numpy as np

from backends.vulkan.selftests import tiles
from backends.vulkan.selftests.bench import Bench, differ

TASK = """
layout(local_size_x = 8) in;
struct Payload { uint tiles[8]; };
taskPayloadSharedEXT Payload payload;
shared uint count;
void main() {
    uint tile = gl_WorkGroupID.x * 8u + gl_LocalInvocationIndex;
    if (gl_LocalInvocationIndex == 0u) count = 0u;
    barrier();
    if (tile % 3u == 0u) payload.tiles[atomicAdd(count, 1u)] = tile;
    barrier();
    EmitMeshTasksEXT(count, 1, 1);
}
"""


def run(bench: Bench) -> str:
    """Return what was wrong, or ""."""
    sources = {"task": TASK, "mesh": "#define TASKS 1\n" + tiles.MESH, "frag": tiles.FRAGMENT}
    program = bench.graphics(sources, extensions=tiles.EXTENSIONS)
    pixels = bench.render(
        program, tiles.SIZE, lambda commands: bench.fn.vkCmdDrawMeshTasksEXT(commands, 6, 1, 1)
    )
    every = tiles.expected(48)
    return differ("pixels", pixels, np.where(every % 3 == 1, every, 0).astype(np.uint32))
