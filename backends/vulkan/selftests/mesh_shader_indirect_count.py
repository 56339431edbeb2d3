"""Self-test: the GPU's own number of mesh draws, below the length of the list, with an empty draw in its middle."""

from __future__ import annotations

import numpy as np

from backends.vulkan.selftests import tiles
from backends.vulkan.selftests.bench import Bench, differ

MESH = tiles.MESH.replace("gl_WorkGroupID.y * 8u", "uint(gl_DrawID) * 8u")


def run(bench: Bench) -> str:
    """Return what was wrong, or ""."""
    program = bench.graphics({"mesh": MESH, "frag": tiles.FRAGMENT}, extensions=tiles.EXTENSIONS)
    # Workgroups in x, y, z and a word between the records; the fourth draw is beyond the count.
    groups = np.array([(8, 1, 1, 9), (0, 1, 1, 9), (5, 1, 1, 9), (8, 1, 1, 9)], np.uint32)
    draws, count = bench.input(groups), bench.input(np.array([3], np.uint32))
    pixels = bench.render(
        program,
        tiles.SIZE,
        lambda commands: bench.fn.vkCmdDrawMeshTasksIndirectCountEXT(
            commands, draws.handle, 0, count.handle, 0, 4, 16
        ),
    )
    every = tiles.expected(21)
    second = (every > 8) & (every <= 16)
    return differ("pixels", pixels, np.where(second, 0, every).astype(np.uint32))
