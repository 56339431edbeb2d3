"""Self-test: what is drawn into a sparse depth attachment of several pages is what a copy reads from it."""

from __future__ import annotations

import numpy as np

from backends.vulkan.selftests.bench import FULL_SCREEN, Bench, differ
from backends.vulkan.selftests.pages import SIZE
from backends.vulkan.selftests.sparse_attachment import drawn

FRAGMENT = "void main() { gl_FragDepth = (floor(gl_FragCoord.y) * 256.0 + floor(gl_FragCoord.x)) / 65536.0; }"


def run(bench: Bench) -> str:
    """Return what was wrong, or ""."""
    program = bench.graphics({"vert": FULL_SCREEN, "frag": FRAGMENT}, target="d32f")
    y, x = np.mgrid[0:SIZE, 0:SIZE]
    expected = ((y * 256 + x) / 65536.0).astype(np.float32)
    return differ("depths", drawn(bench, program, "d32f").view(np.float32), expected)
