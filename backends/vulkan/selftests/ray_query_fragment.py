"""Self-test: rays traced in a fragment shader hit the triangles that they hit in float64."""

from __future__ import annotations

import numpy as np

from backends.vulkan.selftests import triangles
from backends.vulkan.selftests.bench import FULL_SCREEN, Bench
from backends.vulkan.selftests.ray_query_compute import EXTENSIONS, TRACE

# Two pixels side by side hold the two words of one ray.
FRAGMENT = (
    TRACE
    + """
layout(location = 0) out uint color;
void main() {
    uvec2 at = uvec2(gl_FragCoord.xy);
    color = trace(at.y * 32u + at.x / 2u)[at.x % 2u];
}
"""
)


def run(bench: Bench) -> str:
    """Return what was wrong, or ""."""
    rays, world = triangles.rays(), triangles.build(bench)
    sources = {"vert": FULL_SCREEN, "frag": FRAGMENT}
    program = bench.graphics(sources, [world, bench.input(rays)], extensions=EXTENSIONS)
    pixels = bench.render(program, (64, 32), lambda commands: bench.fn.vkCmdDraw(commands, 3, 1, 0, 0))
    return triangles.compare(pixels.reshape(-1, 2).astype(np.uint32), rays)
