"""Self-test: a triangle drawn as lines colours its edges and not its inside."""

from __future__ import annotations

import numpy as np

from backends.vulkan import api as vk
from backends.vulkan.selftests.bench import Bench

VERTEX = """
const vec2 CORNERS[3] = vec2[](vec2(2.5, 2.5), vec2(29.5, 2.5), vec2(2.5, 29.5));
void main() { gl_Position = vec4(CORNERS[VERTEX_ID] / 16.0 - 1.0, 0.5, 1); }
"""
FRAGMENT = "layout(location = 0) out uint color; void main() { color = 1u; }"


def run(bench: Bench) -> str:
    """Return what was wrong, or ""."""
    program = bench.graphics({"vert": VERTEX, "frag": FRAGMENT}, polygon_mode=vk.VK_POLYGON_MODE_LINE)
    pixels = bench.render(program, (32, 32), lambda commands: bench.fn.vkCmdDraw(commands, 3, 1, 0, 0))
    y, x = np.mgrid[0:32, 0:32] + 0.5
    # The distance of each pixel's centre to the nearest of the three lines, and whether it is inside by more.
    inner = np.minimum(np.minimum(x - 2.5, y - 2.5), (32.0 - x - y) / np.sqrt(2.0))
    if (pixels[np.abs(inner) > 1.5] != 0).any():
        return "pixels away from the edges were drawn"
    # The pixels of the two straight edges, without their ends, where lines of drivers differ.
    if not (pixels[2, 5:27] == 1).all() or not (pixels[5:27, 2] == 1).all():
        return "pixels of a straight edge are missing"
    diagonal = pixels[np.abs(x + y - 32.0) < 1.1].sum()
    return "" if diagonal >= 20 else "the diagonal edge is missing"
