"""Self-test: a sparse fetch from an image that is not sparse returns its texels, all of them resident."""

from __future__ import annotations

import numpy as np

from backends.vulkan.selftests.bench import Bench, differ
from backends.vulkan.selftests.sparse_sampled import EXTENSIONS, SOURCE


def run(bench: Bench) -> str:
    """Return what was wrong, or ""."""
    data = np.arange(256 * 256, dtype=np.uint32).reshape(256, 256) + 7
    output = bench.output(2 * data.size)
    bench.dispatch(SOURCE, [bench.texture("r32ui", data), output], data.size // 64, EXTENSIONS)
    words = bench.read(output, np.uint32).reshape(-1, 2)
    wrong = differ("residency codes", words[:, 0], np.ones(data.size, np.uint32))
    return wrong or differ("texels", words[:, 1], data.ravel())
